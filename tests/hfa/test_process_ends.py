"""Warnings of a run are notes."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest
from cli import hfa, hfa_process
from game_files import small


@pytest.mark.filterwarnings("default")
def test_warnings_are_printed_as_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each distinct warning of a successful run is printed as a note. A failed run prints none.

    Deprecation warnings are not printed, and --quiet suppresses all notes.
    """
    from hfa.commands import game

    extreme = small(tmp_path / "extreme.json", A=[[1e200, 1e200], [-1e200, 3e150]])
    refused = hfa_process("solve", "--model", extreme, folder=tmp_path)
    assert (refused.code in (1, 2), refused.err.count("\n")) == (True, 1), refused.err
    plain = hfa("solve", "--model", small(tmp_path / "plant.json"))
    solve = game.solve.run

    def warning(arguments) -> int:
        for text in ("overflow\nin multiply", "overflow\nin multiply"):
            warnings.warn(text, RuntimeWarning, stacklevel=1)
        warnings.warn("two chunks were damaged", stacklevel=1)
        warnings.warn("oneOf is now one_of", DeprecationWarning, stacklevel=1)
        return solve(arguments)

    # No plant causes all of these warnings of libraries.
    monkeypatch.setattr(game, "solve", game.solve._replace(run=warning))
    result = hfa("solve", "--model", str(tmp_path / "plant.json"))
    notes = (
        "hfa: note: two chunks were damaged\nhfa: note: while computing: overflow in multiply;"
        " check the result\n"
    )
    assert (result.code, result.out, result.err) == (plain.code, plain.out, plain.err + notes)
    assert hfa("solve", "--quiet", "--model", str(tmp_path / "plant.json")).err == ""
