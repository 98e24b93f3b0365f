"""What the game from measured outputs says of a scalar plant."""

from __future__ import annotations

import numpy as np
import pytest

from controller import Game
from controller.analysis.plant_report import output_report
from hfa_support import NoSolutionError
from verification import OutputGame

ONE = np.eye(1)


def problem(delta: float, e: float = 1.0) -> OutputGame:
    return OutputGame(Game(A=0.5 * ONE, B=2 * ONE, E=e * ONE, Q=3 * ONE, R=ONE, delta=delta), ONE, 0 * ONE, 0.25 * ONE)


def test_it_names_what_ends_the_smallest_delta_and_the_noise() -> None:
    report = output_report(problem(9.0), ("alpha",), ("rad",))
    smallest = report.data["delta_min"]
    assert report.title.endswith(f"delta 9, smallest possible {smallest:.7g}, where the coupling condition ends it")
    assert report.data["delta_margin"] == pytest.approx(9.0 / smallest)
    assert [tuple(row) for row in report.parts[0].rows] == [("alpha", "0.25", "(rad)^2 s")]  # type: ignore[union-attr]
    with pytest.raises(NoSolutionError, match=r"is below delta_min = .*, where the coupling condition fails"):
        output_report(problem(0.99 * smallest), ("alpha",), ("rad",))


def test_where_nothing_costs_every_delta_will_do() -> None:
    game = Game(A=-0.5 * ONE, B=2 * ONE, E=ONE, Q=0 * ONE, R=ONE, delta=9.0)
    report = output_report(OutputGame(game, ONE, 0 * ONE, 0.25 * ONE), ("alpha",), ("rad",))
    assert report.title == "From measured outputs alone: delta 9, smallest possible 0"
    assert (report.data["delta_min"], report.data["delta_margin"], report.data["coupling"]) == (0.0, None, 0.0)
