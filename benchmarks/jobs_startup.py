"""How long the command takes to answer, a new process each time, against importing python-control."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from benchmarks.report import Row
from benchmarks.timing import in_turn

_HFA = str(Path(sys.executable).with_name("hfa"))


def rows(quick: bool = False) -> list[Row]:
    """A trim, and the help, from nothing to the last line."""
    repeats = 1 if quick else 11
    peer = [sys.executable, "-c", "import control"]
    return [
        Row(
            f"`hfa {' '.join(words)}`, new process",
            '`python -c "import control"`',
            in_turn(lambda words=words: _run([_HFA, *words]), lambda: _run(peer), repeats=repeats),
            1.0,
        )
        for words in (["trim", "--dihedral", "15"], ["--help"])
    ]


def _run(words: list[str]) -> None:
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
