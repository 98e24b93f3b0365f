"""The lists of planted wrong lines, tests/mutants/*.toml, fit the source."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from mutants import read_lists  # noqa: E402


def test_each_mutant_fits_the_source():
    """The text that a mutant (a planted fault) replaces, `before`, is in its file exactly once, or
    `planted` raises ValueError. No mutant is listed twice.
    """
    mutants = read_lists([])
    for mutant in mutants:
        mutant.planted((ROOT / mutant.file).read_text(encoding="utf-8"))
    assert len({(mutant.file, mutant.before, mutant.after) for mutant in mutants}) == len(mutants)
