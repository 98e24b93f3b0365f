"""The lists of planted wrong lines, tests/mutants/*.toml, fit the source."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from mutants import read_lists  # noqa: E402


def test_each_wrong_line_can_be_planted():
    """The text that each wrong line replaces is in its file once, and no wrong line is listed
    twice.
    """
    mutants = read_lists([])
    for mutant in mutants:
        mutant.planted((ROOT / mutant.file).read_text(encoding="utf-8"))
    assert len({(mutant.file, mutant.before, mutant.after) for mutant in mutants}) == len(mutants)
