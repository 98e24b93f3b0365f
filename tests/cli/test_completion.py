"""Completion in a shell: the documented line writes a script that completes commands and their options."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hfa_cli.main import COMMANDS

PARSER = "hfa_cli.main.whole_parser"
#: What bash calls, with the words typed so far.
ASK = """
source completions
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
$(complete -p hfa | sed 's/.*-F \\([^ ]*\\).*/\\1/') hfa "${@: -1}"
echo "${COMPREPLY[@]}"
"""


def written(shell: str) -> str:
    words = [sys.executable, "-m", "shtab", "--prog", "hfa", "--shell", shell, PARSER]
    return subprocess.run(words, check=True, capture_output=True, text=True, timeout=60).stdout


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
def test_bash_completes_commands_and_options(tmp_path: Path) -> None:
    (tmp_path / "completions").write_text(written("bash"), encoding="utf-8")

    def completed(*typed: str) -> list[str]:
        words = ["bash", "-c", ASK, "ask", *typed]
        return subprocess.run(words, cwd=tmp_path, check=True, capture_output=True, text=True).stdout.split()

    assert set(completed("hfa", "")) >= set(COMMANDS)
    assert completed("hfa", "swe") == ["sweep"]
    assert completed("hfa", "sweep", "--cond") == ["--condition"]
    assert "--dihedral" in completed("hfa", "trim", "--")
    assert completed("hfa", "trim", "--nothing") == []
