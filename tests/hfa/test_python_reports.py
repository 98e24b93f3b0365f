"""Reports in Python equal those of the commands, and mention no command-line option."""

from __future__ import annotations

import re

import numpy as np
import pytest
from cli import hfa as command
from project import ROOT

import hfa
from hfa_support.reporting.report import Report
from verification import regenerate_all

NAVION = f"{ROOT}/examples/navion.py:NAVION"


def without_source(text: str) -> str:
    return re.sub(r"\n+hfa \d+\.\d+\.\d+, .*\Z", "", text, flags=re.S).rstrip()


@pytest.mark.parametrize(
    ("aircraft", "hold", "words"),
    [
        ("", {"dihedral": np.radians(10.0)}, ("--dihedral", "10")),
        (
            NAVION,
            {"speed": 180.0},
            ("--aircraft", NAVION, "--hold", "speed=180"),
        ),
    ],
)
def test_a_points_report_equals_the_commands(
    aircraft: str, hold: dict[str, float], words: tuple[str, ...]
) -> None:
    """The report of an operating point in Python equals the text of `hfa trim`."""
    model = hfa.load_model(aircraft) if aircraft else hfa.aircraft()
    point = hfa.trim(model, hold=hold)
    assert without_source(command("trim", *words).out) == point.report().text()
    assert point.report().data["search"]["unknowns"] >= 4


def reports() -> list[Report]:
    """Return seven reports of trims, a linear model, verdicts and a regeneration."""
    model = hfa.aircraft()
    point = hfa.trim(model, hold={"dihedral": 0.2})
    two = {"dihedral": np.radians(10.0), "throttle": 45.0, "aileron_outer": np.radians(1.0)}
    other = hfa.trim(model, hold=two, free=("alpha", "speed"))
    assert "Another trim" in other.report().text()
    game = hfa.paper.published_game(hfa.linearize(model, point))
    K = hfa.solve(game).K
    verdicts = [hfa.verify(game, hfa.from_gain(game, factor * K)) for factor in (1.002, -1.0)]
    assert [verdict.grade for verdict in verdicts] == ["near", "fail"]
    return [
        *(result.report() for result in (point, other, hfa.linearize(model, point), *verdicts)),
        *(regenerate_all(model).report(), regenerate_all(model).summary()),
    ]
