"""The stored results of the studies of best flights."""

from __future__ import annotations

import json

import numpy as np
import pytest
from project import ROOT

import hfa
from studies.best_flights.__main__ import DEGREES, LIMITS, START, best_flight_and_policies
from studies.best_flights.examination import (
    AIRCRAFT,
    summary,
    table,
)

EXAMINED = ROOT / "studies" / "best_flights" / "results" / "examination.json"
STORED = ROOT / "studies" / "best_flights" / "results" / "best_flights.json"


def test_stored_linear_models_are_current() -> None:
    """The A and B stored by the study equal those of the current aircraft.

    Flights are stored for every dihedral angle within each set of limits.
    """
    data = json.loads(STORED.read_text(encoding="utf-8"))
    assert data["start"] == START
    for stored in data["models"]:
        linear = hfa.paper.level_model(hfa.aircraft(), np.radians(stored["dihedral_deg"]))
        np.testing.assert_allclose(stored["A"], linear.A, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(stored["B"], linear.B, rtol=1e-9, atol=1e-9)
    flown = [(each["within"], each["dihedral_deg"]) for each in data["flights"]]
    assert flown == [(name, degrees) for name in LIMITS for degrees in DEGREES]


@pytest.mark.slow
@pytest.mark.parametrize("index", [2, 5])
def test_a_new_search_gives_the_stored_costs(index: int) -> None:
    """A new search gives the stored costs of a best flight, of a planned one and of the policies."""
    data = json.loads(STORED.read_text(encoding="utf-8"))
    stored = data["flights"][index]
    linear = hfa.paper.level_model(hfa.aircraft(), np.radians(stored["dihedral_deg"]))
    best = best_flight_and_policies(linear, LIMITS[stored["within"]])
    assert best.cost == pytest.approx(stored["best"]["cost"], rel=0.005)
    lqr, learned, exact, predictive = best.policies
    assert predictive.cost == pytest.approx(stored["predictive"]["cost"], rel=0.005)
    assert predictive.departure is None
    assert learned.cost == pytest.approx(stored["learned_critic"]["cost"], rel=1e-3)
    assert exact.cost == pytest.approx(stored["exact_policy"]["cost"], rel=1e-3)
    assert lqr.cost == pytest.approx(stored["exact_lqr"]["cost"], rel=1e-3)


def test_the_page_shows_the_stored_flights() -> None:
    """The table in docs/nonlinear.md follows from the stored flights of the examination.

    The stored flights meet its requirements. The costs by SciPy agree within 1 %, the costs on
    finer meshes within 0.5 %, and 95 % of the flights are found.
    """
    rows = json.loads(EXAMINED.read_text(encoding="utf-8"))["aircraft"]
    page = (ROOT / "docs" / "nonlinear.md").read_text(encoding="utf-8")
    assert [(row["aircraft"], row["starts"]) for row in rows] == [(name, 50) for name in AIRCRAFT]
    for row, shown in zip(rows, table(rows).rows, strict=True):
        assert f"| {' | '.join(map(str, shown))} |" in page
        again = summary(row["flights"])
        assert all(again[name] == row[name] for name in ("starts", "found", "meshes"))
        assert again["off_independent"] == pytest.approx(row["off_independent"])
        assert row["off_independent"] < 0.01
        assert row["meshes"] <= 0.005
        assert row["found"] >= 0.95 * row["starts"]
