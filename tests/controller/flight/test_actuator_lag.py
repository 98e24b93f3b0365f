"""How much lag of its actuators the linear policy stands: eigenvalues, long flights, and the rows that say so."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from known_models import game_at, model_at

from controller import Actuators, Scenario, Signal, flight_envelope, fly, gain_law
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_model import LINEAR_STATES, Aircraft, Input
from hfa_model.vectors import CONTROL_LIMITS
from trim import LinearModel
from verification import solve_game

DOCUMENT = Path(__file__).parents[3] / "docs" / "nonlinear.md"
WEIGHTS = ("the paper's weights", "R x 100")


@cache
def gain(weights: str) -> np.ndarray:
    """The exact gain at 15 degrees."""
    game = game_at(15.0, "newton")
    return solve_game(game if weights == WEIGHTS[0] else replace(game, R=100.0 * game.R, delta=2000.0)).K


def abscissa(model: LinearModel, K: np.ndarray, lag: float) -> float:
    """Of x' = A x + B a, a' = (-K x - a) / lag, 1/s."""
    loop = np.block([[model.A, model.B], [-K / lag, -np.eye(len(K)) / lag]])
    return float(np.linalg.eigvals(loop).real.max())


def largest_lag(model: LinearModel, K: np.ndarray) -> float:
    """The lag at which the loop loses its stability, s, by bisection."""
    low, high = 0.001, 0.3
    assert abscissa(model, K, low) < 0.0 < abscissa(model, K, high)
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if abscissa(model, K, middle) < 0.0 else (low, middle)
    return low


def flown(weights: str, lag: float, seconds: float) -> NonlinearFlight:
    """A command of one degree behind actuators of that lag, 60 deg/s for the surfaces."""
    aircraft, point = Aircraft(dynamics="newton"), model_at(15.0, "newton").point
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    actuators = Actuators(Input(*[lag] * 5), lowest, highest, Input(np.inf, *[float(np.radians(60.0))] * 4))
    command = np.array([np.radians(1.0) if name == "dihedral" else 0.0 for name in LINEAR_STATES])
    scenario = Scenario(duration=seconds, reference=Signal(command, np.zeros(len(command))), actuators=actuators)
    envelope = flight_envelope(aircraft, point)
    return fly(aircraft, point, gain_law("exact", gain(weights)), scenario, envelope)


def stated(row: str) -> tuple[float, ...]:
    """The two lags of the row of docs/nonlinear.md that begins so, s."""
    text = DOCUMENT.read_text(encoding="utf-8")
    found = re.findall(rf"^\| {re.escape(row)}[^|]* \| ([\d.]+) s \| ([\d.]+) s \|$", text, re.MULTILINE)
    assert len(found) == 1, row
    return tuple(float(number) for number in found[0])


def rounded_down(lag: float) -> float:
    """To a millisecond, so that the stated lag is one that is stood."""
    return math.floor(1000.0 * lag) / 1000.0


@pytest.mark.parametrize("degrees", [15.0, 16.0])
def test_the_lags_of_the_document_are_where_the_eigenvalues_turn(degrees: float) -> None:
    found = tuple(rounded_down(largest_lag(model_at(degrees, "newton"), gain(weights))) for weights in WEIGHTS)
    assert stated(f"lag of all actuators, eigenvalues at {degrees:g} deg") == found


@pytest.mark.slow  # the eigenvalues are above, shorter flights below
@pytest.mark.parametrize("weights", WEIGHTS)
def test_flights_of_200_s_hold_at_the_stated_lag_and_are_lost_at_a_little_more(weights: str) -> None:
    limit = stated("lag of all actuators, simulated 200 s")[WEIGHTS.index(weights)]
    assert flown(weights, limit, 200.0).departure is None
    assert flown(weights, limit + 0.002, 200.0).departure is not None
