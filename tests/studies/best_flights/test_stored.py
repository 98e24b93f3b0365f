"""The stored flights from the paper's x(0)."""

from __future__ import annotations

import json

import numpy as np
import pytest
from project import ROOT

import hfa
from studies.best_flights.__main__ import DEGREES, LIMITS, START, best_beside_policies

STORED = ROOT / "studies" / "best_flights" / "results" / "best_flights.json"


def test_stored_linear_models_are_todays() -> None:
    """The aircraft that flew is the one that is shipped; each flight has its angle and limits."""
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
def test_a_flight_is_found_again(index: int) -> None:
    data = json.loads(STORED.read_text(encoding="utf-8"))
    stored = data["flights"][index]
    linear = hfa.paper.level_model(hfa.aircraft(), np.radians(stored["dihedral_deg"]))
    best = best_beside_policies(linear, LIMITS[stored["within"]])
    assert best.cost == pytest.approx(stored["best"]["cost"], rel=0.005)
    lqr, exact = best.policies
    assert exact.cost == pytest.approx(stored["exact_policy"]["cost"], rel=1e-3)
    assert lqr.cost == pytest.approx(stored["exact_lqr"]["cost"], rel=1e-3)
