"""The study that compares costs of flights with proved lower bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hfa
from hfa import linearize
from hfa_flight.problem import flight_problem
from hfa_prove.problem import plant_of
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.piece import Piece, Polynomial
from studies.bounds.__main__ import main
from studies.bounds.aircraft import navion_of_the_tutorial
from studies.bounds.flexible import FLEXIBLE
from studies.bounds.flights import CostRatios, cost_ratios


def cart(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"position": u.speed}, {}


def costs_over_bound(coefficient: float) -> CostRatios:
    """Return the costs of flights of x' = u with Q = R = 1, compared with the bound W = k x².

    The least cost is x².

    coefficient: k
    """
    model = hfa.Model("cart", {"position": hfa.Signal("m")}, {"speed": hfa.Signal("m/s")}, cart)
    problem = flight_problem(model, hfa.trim(model))
    still = {"position": 0.0, "speed": 0.0}
    piece = Piece(np.eye(1) / 64.0, Polynomial(1, ((4096.0 * coefficient, (2,)),)), 4096.0)
    bound = CostStatement(plant_of(problem), still, np.eye(1), np.eye(1), (piece,))
    return cost_ratios(problem, bound, 500)


def test_no_flight_costs_less_than_a_bound() -> None:
    """No flight costs less than a bound of 0.999 times the least cost."""
    flown = costs_over_bound(0.999)
    assert flown.flights >= 500
    assert flown.below == 0
    assert flown.least == pytest.approx(1.0 / 0.999, abs=0.01)


def test_flights_below_a_false_bound_are_counted() -> None:
    """Flights that cost less than a bound of 1.01 times the least cost are counted."""
    assert costs_over_bound(1.01).below > 100


def test_the_navion_equals_the_tutorials_navion() -> None:
    """The Navion of the study has the four states of the tutorial's Navion."""
    assert navion_of_the_tutorial().linear == ("speed", "alpha", "pitch", "pitch_rate")


def test_the_flexible_aircraft_equals_the_paper() -> None:
    """A and B of the study's aircraft with constant altitude equal those of the paper's
    aircraft.
    """
    dihedral = {"dihedral": float(np.radians(10.0))}
    paper = hfa.trim(hfa.aircraft("published"), hold=dihedral)
    own = hfa.trim(FLEXIBLE)
    assert np.array_equal(linearize(FLEXIBLE, own).A, linearize(paper.model, paper).A)
    assert np.array_equal(linearize(FLEXIBLE, own).B, linearize(paper.model, paper).B)
    assert plant_of(flight_problem(FLEXIBLE, own)).limits["speed"] == (34.0, 136.0)


@pytest.mark.slow
def test_the_study_proves_a_bound_and_simulates(
    tmp_path: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    """The study proves a bound for the van der Pol oscillator and simulates 100 trajectories."""
    words = ["--aircraft", "van der Pol", "--starts", "2", "--flights", "100", "-o", str(tmp_path)]
    assert main(words) == 0
    assert "van der Pol" in capsys.readouterr().out
