"""Completion of the command line in bash."""

import subprocess
import sys

import pytest

from hfa.completion import candidates


@pytest.mark.parametrize(
    ("typed", "expected"),
    [
        (["li"], ["linearize"]),
        (["prove", "re"], ["region"]),
        (["sweep", "--dih"], ["--dihedral"]),
        (["trim", "--dihedral", "10", "--dyn"], ["--dynamics"]),
        (["prove", "region", "--prov"], ["--prover"]),
        (["nothing", "--dih"], []),
        (["trim", "file"], []),
    ],
)
def test_words_of_a_line_are_completed(typed: list[str], expected: list[str]) -> None:
    """On a command line, commands, second words of commands, and options are completed."""
    assert candidates(typed) == expected


def test_bash_completes_a_command() -> None:
    """bash calls the module (`complete -C`) and reads the candidates from its output."""
    line = "hfa li"
    done = subprocess.run(
        [sys.executable, "-m", "hfa.completion", "hfa", "li", "hfa"],
        env={"COMP_LINE": line, "COMP_POINT": str(len(line)), "PATH": ""},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert done.stdout == "linearize\n"
