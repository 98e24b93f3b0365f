"""Actuators: response within their limits, and the largest lags that linear policies tolerate.

The lags are compared with docs/nonlinear.md.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_models import game_at, model_at
from project import ROOT

import hfa
from hfa import BadInputError, LinearModel, fly, solve
from hfa_flight import ActuatorBank, ActuatorFault, GainPolicy, Scenario, Waveform, flight_envelope
from hfa_flight.closed_loop import ClosedLoop, LinearPlant
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import OpenLoop
from hfa_flight.simulation import CompiledLoop
from hfa_model import INPUTS, LINEAR_STATES, Input, published_models
from hfa_model.vectors import CONTROL_LIMITS

N = 6
M = len(INPUTS)
FREE = ActuatorBank(
    Input(*[0.1] * M), Input(*[-np.inf] * M), Input(*[np.inf] * M), Input(*[np.inf] * M)
)
LIMITED = ActuatorBank(Input(*[0.1] * M), Input(*[-0.5] * M), Input(*[0.4] * M), Input(*[1.0] * M))


def flight_under_command(actuators: ActuatorBank, *command: float) -> Deviations:
    """Return a flight of two seconds of the first published linear model under a constant
    command.
    """
    model = published_models()[0]
    law = OpenLoop("none", held=np.array([command]))
    scenario = Scenario(2.0, tick=0.1, initial=np.zeros(N), actuators=actuators)
    return CompiledLoop(ClosedLoop(LinearPlant(model.A, model.B), law, scenario)).fly()


@pytest.mark.parametrize("order", [1, 2])
def test_positions_and_rates_stay_within_their_limits(order: int) -> None:
    """Positions and rates of actuators of both orders remain within their limits.

    The commands exceed the limits.
    """
    limited, free = (
        flight_under_command(replace(each, order=order), 10.0, -10.0, 0.3, -0.05, 0.0)
        for each in (LIMITED, FREE)
    )
    assert limited.inputs.max() <= 0.4
    assert limited.inputs.min() >= -0.5
    rates = np.diff(limited.inputs, axis=0) / 0.001
    assert np.abs(rates).max() <= 1.0 + 1e-9
    # The limits matter: commands exceed them, and the fastest motion is at the rate limit.
    assert np.abs(free.inputs).max() > 9.0
    assert np.abs(rates).max() == pytest.approx(1.0)
    np.testing.assert_allclose(limited.inputs[-1], [0.4, -0.5, 0.3, -0.05, 0.0], atol=1e-3)


def test_a_lag_unresolved_by_the_step_is_refused() -> None:
    """A lag too short for the integration step is refused, and accepted with a shorter step."""
    lag = Input(0.5, *[0.0003] * (M - 1))
    fast = ActuatorBank(lag, LIMITED.lowest, LIMITED.highest, LIMITED.rate)
    fast.refuse_step(0.00075)
    said = (
        rf"the lag of {INPUTS[1]} is 0\.0003 s, but a step of 0\.001 s requires at least"
        r" 0\.0004 s"
    )
    with pytest.raises(BadInputError, match=said):
        Scenario(actuators=fast)
    assert Scenario(step=0.0005, actuators=fast).actuators is fast


def test_order_2_actuators_have_the_analytical_response() -> None:
    """Actuators of order 2 have the analytical step response of a second-order lag."""
    second = replace(FREE, order=2, damping=0.7)
    flight = flight_under_command(second, 1.0, -2.0, 0.0, 0.0, 0.0)
    w = 10.0
    v = 10.0 * np.sqrt(1 - 0.7**2)
    t = flight.times
    response = 1 - np.exp(-0.7 * w * t) * (np.cos(v * t) + 0.7 * w / v * np.sin(v * t))
    np.testing.assert_allclose(flight.inputs[:, :2], response[:, None] * [1.0, -2.0], atol=1e-8)


def test_a_fault_changes_only_the_named_actuator() -> None:
    """A fault changes effectiveness and bandwidth of the named actuator only, from its start on."""
    fault = ActuatorFault(0.5, 0.25, 2.0, inputs=("aileron_outer",))
    flight = flight_under_command(replace(FREE, faults=(fault,)), 0.0, 1.0, 1.0, 0.0, 0.0)
    whole = 1.0 - np.exp(-flight.times / 0.1)
    t = flight.times
    np.testing.assert_allclose(flight.inputs[:, 1], whole, atol=1e-9)
    before = 1.0 - np.exp(-0.5 / 0.1)
    failed = np.where(t <= 0.5, whole, 0.25 + (before - 0.25) * np.exp(-2.0 * (t - 0.5)))
    np.testing.assert_allclose(flight.inputs[:, 2], failed, atol=1e-9)


DOCUMENT = ROOT / "docs" / "nonlinear.md"
WEIGHTS = ("the paper's weights", "R x 100")


@cache
def gain(weights: str) -> np.ndarray:
    """Return the exact gain at 15 degrees, for one of the two sets of `WEIGHTS`."""
    game = game_at(15.0, "newton")
    return solve(game if weights == WEIGHTS[0] else replace(game, R=100.0 * game.R, delta=2000.0)).K


def abscissa(model: LinearModel, K: np.ndarray, lag: float) -> float:
    """Return the spectral abscissa of x' = A x + B a, a' = (-K x - a) / lag, 1/s."""
    loop = np.block([[model.A, model.B], [-K / lag, -np.eye(len(K)) / lag]])
    return float(np.linalg.eigvals(loop).real.max())


def leaves_envelope(weights: str, lag: float) -> bool:
    """Return whether a flight of 200 s with a dihedral command of one degree leaves the envelope.

    The surfaces move at most 60 deg/s.

    weights: one of `WEIGHTS`, for the gain
    lag: lag of all actuators, s
    """
    aircraft = hfa.aircraft("newton")
    point = model_at(15.0, "newton").point
    fastest = float(np.radians(60.0))
    actuators = ActuatorBank(
        Input(*[lag] * 5),
        Input(*(low for low, _ in CONTROL_LIMITS)),
        Input(*(high for _, high in CONTROL_LIMITS)),
        Input(np.inf, *[fastest] * 4),
    )
    command = np.radians([float(name == "dihedral") for name in LINEAR_STATES])
    scenario = Scenario(
        duration=200.0, reference=Waveform(command, np.zeros(len(command))), actuators=actuators
    )
    flight = fly(
        aircraft,
        point,
        GainPolicy("exact", gain(weights)),
        scenario=scenario,
        envelope=flight_envelope(aircraft, point),
        predict=False,
    )
    return flight.departure is not None


def stated(row: str) -> tuple[float, ...]:
    """Return the two lags, s, in the row of docs/nonlinear.md that begins with `row`."""
    text = DOCUMENT.read_text(encoding="utf-8")
    found = re.findall(
        rf"^\| {re.escape(row)}[^|]* \| ([\d.]+) s \| ([\d.]+) s \|$", text, re.MULTILINE
    )
    assert len(found) == 1, row
    return tuple(float(number) for number in found[0])


@pytest.mark.parametrize("degrees", [15.0, 16.0])
def test_documented_lags_are_the_stability_limits(degrees: float) -> None:
    """The closed loop is stable at the documented lag and unstable with 1 ms more."""
    for weights, limit in zip(WEIGHTS, stated(f"eigenvalues at {degrees:g} deg"), strict=True):
        model = model_at(degrees, "newton")
        K = gain(weights)
        assert (
            abscissa(model, K, limit) < 0.0 < abscissa(model, K, limit + 0.001)
        )  # rounded down to a millisecond


@pytest.mark.slow  # shorter tests are above and below
@pytest.mark.parametrize("weights", WEIGHTS)
def test_flights_of_200_s_confirm_the_largest_lag(
    weights: str,
) -> None:
    """A flight of 200 s stays inside the envelope at the documented lag and leaves it with 2 ms
    more.
    """
    limit = stated("simulation of 200 s")[WEIGHTS.index(weights)]
    assert (leaves_envelope(weights, limit), leaves_envelope(weights, limit + 0.002)) == (
        False,
        True,
    )
