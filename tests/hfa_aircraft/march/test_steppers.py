"""Steppers: order of Runge-Kutta, linear loops, LSODA, recurrences."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from hfa_aircraft.march.march import Free, march
from hfa_aircraft.march.steppers import Adaptive, Recurrence, Ticks, rk4

START = np.array([2.5, 0.0])
SECONDS = 6.0


def pendulum(x: np.ndarray, _: float) -> np.ndarray:
    """Return the rates of the pendulum x1'' = -sin x1."""
    return np.array([x[1], -np.sin(x[0])])


def swung(steps: int) -> np.ndarray:
    """Return the state of the pendulum after `SECONDS`."""
    x = START
    for _ in range(steps):
        x = rk4(pendulum, x, SECONDS / steps)
    return x


def test_the_method_is_of_order_four() -> None:
    """The error of a nonlinear pendulum decreases with the fourth power of the step."""
    exact = solve_ivp(
        lambda t, x: pendulum(x, 0.0),
        (0.0, SECONDS),
        START,
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
    ).y[:, -1]
    coarse, fine = (np.abs(swung(steps) - exact).max() for steps in (400, 800))
    assert np.log2(coarse / fine) == pytest.approx(4.0, abs=0.2)


def test_a_linear_loop_follows_its_exponential() -> None:
    """A step is the Taylor series of exp(A h) up to h⁴."""
    A = np.array([[-0.4, 1.0, 0.0], [-2.0, -0.1, 0.3], [0.0, 0.2, -1.0]])
    h = 0.05
    step = np.column_stack([rk4(lambda x, _: A @ x, column, h) for column in np.eye(3)])
    remainder = np.linalg.matrix_power(A * h, 5) / 120.0
    assert np.abs(step - expm(A * h) + remainder).max() < 0.05 * np.abs(remainder).max()


def test_the_fraction_of_the_step_places_time_dependent_rates() -> None:
    """x' = (t / h)³ over one step has the exact integral h / 4 of Simpson's rule."""
    h = 0.3
    assert float(rk4(lambda x, c: np.array([c**3]), np.zeros(1), h)[0]) == pytest.approx(h / 4.0)


def test_expressions_and_arrays_have_equal_bits() -> None:
    """The compiled step of CasADi has the same order of operations as that of NumPy."""
    x = ca.SX.sym("x", 2)
    after = rk4(lambda x, _: ca.vertcat(x[1], -ca.sin(x[0])), x, 0.1)
    step = ca.Function("step", [x], [after])
    for start in np.random.default_rng(0).normal(size=(50, 2)):
        np.testing.assert_array_equal(np.array(step(start)).ravel(), rk4(pendulum, start, 0.1))


def test_lsoda_follows_the_pendulum_and_stops_where_it_diverges() -> None:
    """The pendulum ends where Runge-Kutta steps end. x' = x², infinite at t = 1, diverges."""
    x = ca.SX.sym("x", 2)
    rate = ca.Function("rate", [x], [ca.vertcat(x[1], -ca.sin(x[0])), ca.sumsqr(x)])
    stepper = Adaptive(rate, SECONDS, largest=1e3, most_steps=10_000)
    (flown, _) = march(Free(stepper, START[None]), 1)
    np.testing.assert_allclose(flown.states[0, -1], swung(2000), atol=1e-5)
    y = ca.SX.sym("y")
    explosion = ca.Function("rate", [y], [y**2, y])
    for seconds, largest, ends in ((0.9, 1e6, 10.0), (0.9, 5.0, np.nan), (1.1, 1e6, np.nan)):
        stepper = Adaptive(explosion, seconds, largest=largest, most_steps=10_000)
        (flown, _) = march(Free(stepper, np.ones((1, 1))), 1)
        np.testing.assert_allclose(flown.states[0, -1], ends, rtol=1e-4)


def test_a_recurrence_and_ticks_have_the_powers_of_a_matrix() -> None:
    """x⁺ = A x has the states A^k x, by a recurrence and by rows with what is held in addition."""
    A = np.array([[0.9, 0.2], [-0.1, 0.95]])
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u", 0)
    by_power = [np.linalg.matrix_power(A, k) @ START for k in range(13)]
    one = Recurrence(ca.Function("after", [x], [ca.DM(A) @ x]), steps=4)
    rows = Ticks(ca.Function("after", [x, u], [ca.DM(A) @ x]), 0.1)
    for stepper, ticks in ((one, 3), (rows, 12)):
        (flown, _) = march(Free(stepper, START[None]), ticks)
        np.testing.assert_allclose(flown.states[0], by_power, rtol=1e-13)
