"""Signals that are known at every time, and step commands: the closed form is the filter's differential equation."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from controller import CommandSteps, Signal
from controller.policy.signals import CommandedStates, Harmonic
from hfa_model import LINEAR_STATES

TIMES, VALUES = np.array([1.0, 4.0, 9.0]), np.array([[1.0, -2.0], [0.5, 0.0], [0.0, 3.0]])


def test_a_signal_is_the_same_at_one_time_at_many_and_as_an_expression() -> None:
    rng = np.random.default_rng(2)
    constant, slope, sine, cosine = rng.normal(size=(4, 3))
    signal = Signal(constant, slope, (Harmonic(1.3, sine, cosine), Harmonic(0.2, cosine, -sine)))
    times, t = np.array([0.0, 0.7, 5.0]), ca.SX.sym("t")
    one = signal.sampled(times)
    compiled = ca.Function("s", [t], [signal.at(t)])
    for row, time in zip(one, times.tolist(), strict=True):
        first = sine * np.sin(1.3 * time) + cosine * np.cos(1.3 * time)
        second = cosine * np.sin(0.2 * time) - sine * np.cos(0.2 * time)
        np.testing.assert_allclose(row, constant + slope * time + first + second, rtol=1e-12)
        np.testing.assert_allclose(signal.at(time), row, rtol=1e-12)
        np.testing.assert_allclose(np.array(compiled(time)).ravel(), row, rtol=1e-12)


def steps(damping: float = 2.0) -> CommandSteps:
    return CommandSteps(("dihedral", "vertical_acceleration_short_period"), TIMES, VALUES, 0.5, damping)


@pytest.mark.parametrize("damping", [0.6, 1.0, 1.5, 2.0])
def test_the_closed_form_solves_the_equation_of_the_filter(damping: float) -> None:
    commands = steps(damping)
    w, y = 0.5, np.zeros(4)
    for begin, end, goal in zip([0.0, *TIMES], [*TIMES, 20.0], [np.zeros(2), *VALUES], strict=True):

        def rate(t: float, y: np.ndarray, goal: np.ndarray = goal) -> np.ndarray:
            return np.concatenate([y[2:], w**2 * (goal - y[:2]) - 2 * damping * w * y[2:]])

        y = solve_ivp(rate, (begin, end), y, rtol=1e-10, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(commands.sampled(np.array([end]))[0], y[:2], atol=1e-8)
        np.testing.assert_allclose(np.array(ca.DM(commands.rate(ca.SX(end)))).ravel(), y[2:], atol=1e-8)


def test_the_reference_of_a_flight_has_the_commanded_states_alone() -> None:
    x_d = np.array(ca.DM(CommandedStates(steps(), LINEAR_STATES).at(ca.SX(6.0)))).ravel()
    r = steps().sampled(np.array([6.0]))[0]
    np.testing.assert_allclose(x_d, [r[0] if name == "dihedral" else 0.0 for name in LINEAR_STATES])
