"""Search for a region, on loops that take seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov

import hfa
from hfa_aircraft.loading import load_model
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.problem import loop_at
from hfa_prove.search.clock import Clock
from hfa_prove.search.level import Setting, ball_of, proved_level
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import first_obstacle, rises
from hfa_prove.statements.loop import Gain, Loop

F16 = f"{Path(__file__).parents[4] / 'examples' / 'f16_constant.py'}:F16"
SETTING = Setting(5, 2)


@pytest.fixture(scope="module")
def loop() -> Loop:
    """Return the closed loop of the F-16 with constant derivatives and its LQR in nominal units."""
    model = load_model(F16)
    linear = hfa.linearize(model, hfa.trim(model))
    Q = np.diag([model.signals[name].nominal ** -2.0 for name in linear.states])
    R = np.diag([model.signals[name].nominal ** -2.0 for name in linear.inputs])
    P = solve_continuous_are(linear.A, linear.B, Q, R)
    return loop_at(linear, Gain(np.linalg.solve(R, linear.B.T @ P)))


@pytest.fixture(scope="module")
def V(loop: Loop) -> PolynomialFunction:
    """Return a Lyapunov function of the linearization, with nominal values as units."""
    plant = LoopValues(loop)
    Q = np.diag(plant.nominal**-2.0)
    return PolynomialFunction.quadratic(solve_continuous_lyapunov(plant.J.T, -Q))


def test_constant_derivatives_keep_the_f16s_trim(loop: Loop) -> None:
    # Stevens and Lewis, Aircraft Control and Simulation: 502 ft/s at sea level, c.g. at 0.35.
    """The F-16 with constant derivatives has the trim of the F-16 with tables."""
    assert loop.trim["speed"] == pytest.approx(502.0)
    assert np.degrees(loop.trim["alpha"]) == pytest.approx(2.1, abs=0.05)
    assert loop.trim["pitch"] == pytest.approx(loop.trim["alpha"])


def test_a_small_level_of_f16_is_proved(loop: Loop, V: PolynomialFunction) -> None:
    """A small level of the F-16 is proved with one part."""
    T = ball_of(V.matrix(), 1.0)
    rho = 1e-3
    proved = proved_level(loop, V, rho, SETTING, T, Clock(600.0))
    assert proved is not None
    assert proved.statement.rho == pytest.approx(rho)
    assert proved.parts == 1  # so small a set does not reach the limits of the inputs


@pytest.mark.slow
def test_largest_level_of_f16_within_limits_is_proved(loop: Loop, V: PolynomialFunction) -> None:
    """The largest level of V for which the set is within the limits of the F-16 is proved.

    For four times this level, no higher level is proved.
    """
    plant = LoopValues(loop)
    P = V.matrix()
    widths = np.einsum("ki,ij,kj->k", plant.limited_rows, np.linalg.inv(P), plant.limited_rows)
    rho = 0.999 * float(np.min(np.min(np.abs(plant.permitted_deviations), axis=1) ** 2 / widths))
    T = ball_of(P, rho)
    proved = proved_level(loop, V, rho, SETTING, T, Clock(600.0))
    assert proved is not None
    assert proved.statement.rho == pytest.approx(rho)
    assert proved.parts == 3  # the elevator reaches both of its limits
    # Twice as far out, alpha exceeds its limits.
    beyond = proved_level(loop, V, 4.0 * rho, SETTING, T, Clock(600.0))
    assert beyond is None or beyond.statement.rho <= rho / 0.999


def test_an_increasing_function_is_not_proved(loop: Loop) -> None:
    """A function that increases along trajectories is not proved."""
    plant = LoopValues(loop)
    length = PolynomialFunction.quadratic(np.diag(plant.nominal**-2.0))
    T = ball_of(length.matrix(), 1e-3)
    assert first_obstacle(rises(plant, length.slope), length, T, quick=True)[0] < 1e-5
    assert proved_level(loop, length, 1e-3, SETTING, T, Clock(600.0)) is None
