"""The march: linear loops against their exponentials, held inputs, and ends of flights."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

from hfa_aircraft.march.march import History, march, saturated
from hfa_aircraft.march.steppers import RungeKutta

A = np.array([[0.0, 1.0], [-4.0, -0.2]])
B = np.array([[0.0], [1.0]])
K = np.array([[1.0, 0.8]])
START = np.array([1.0, -0.5])
STEP = 0.01
STEPS = 5
TICK = STEPS * STEP
TICKS = 80


class Sampled:
    """Loop x' = A x + B u with u = -K x of the last tick, which is seen as a third value."""

    def __init__(self, parts: int = 1, late: int = 0) -> None:
        t, x, u = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("u")
        rate = ca.Function("rate", [t, x, u], [ca.DM(A) @ x + ca.DM(B) @ u])
        seen = ca.Function("seen", [t, x, u], [ca.vertcat(t, u)])
        self.stepper = RungeKutta(rate, seen, STEP, STEPS, parts=parts)
        self.commands = [np.zeros((1, 1))] * late

    def start(self) -> np.ndarray:
        return START[None]

    def hold(self, tick: int, time: float, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        self.commands.append(-state @ K.T)
        return self.commands[tick]


def exact(ticks: int, late: int = 0) -> np.ndarray:
    """Return the states of the sampled loop at the ticks by exponentials, (ticks + 1, 2)."""
    held = expm(np.block([[A, B], [np.zeros((1, 3))]]) * TICK)
    states = [START]
    commands = [np.zeros(1)] * late
    for tick in range(ticks):
        commands.append(-K @ states[-1])
        states.append((held @ np.concatenate([states[-1], commands[tick]]))[:2])
    return np.array(states)


def flown(loop: Sampled, ticks: int = TICKS) -> History:
    """Return the time history of a sampled loop."""
    return march(loop, ticks, window=7)[0]


@pytest.mark.parametrize("late", [0, 1, 3])
def test_a_sampled_loop_follows_its_exponentials(late: int) -> None:
    """Inputs that are held in a tick, also delayed by ticks, give the exact discrete loop."""
    history = flown(Sampled(late=late))
    np.testing.assert_allclose(history.states[0, ::STEPS], exact(TICKS, late), atol=1e-8)
    np.testing.assert_allclose(history.times, STEP * np.arange(TICKS * STEPS + 1))


def test_values_are_seen_before_each_step_and_at_the_end() -> None:
    """The seen times are those of the steps, and the seen input is that of the tick."""
    history = flown(Sampled(), 3)
    np.testing.assert_allclose(history.seen[0, :, 0], history.times, atol=1e-12)
    inputs = -history.states[0, : 3 * STEPS : STEPS] @ K[0]
    np.testing.assert_allclose(history.seen[0, :-1, 1], np.repeat(inputs, STEPS))
    assert history.seen[0, -1, 1] == history.seen[0, -2, 1]


@pytest.mark.parametrize("window", [1, 4, 1000])
def test_a_flight_ends_with_the_tick_of_the_first_step_that_is_over(window: int) -> None:
    """The end does not depend on the number of ticks between two tests, nor do the states."""
    whole = flown(Sampled())
    states, lowest = whole.states[0, :, 0], 0.3
    loop = Sampled()
    history, (end,) = march(
        loop, TICKS, over=lambda rows: rows.states[:, :, 0] < lowest, window=window
    )
    first = int(np.argmax(states < lowest))
    assert first % STEPS > 0
    assert end == STEPS * (first // STEPS + 1)
    np.testing.assert_array_equal(history.states[0, : end + 1], whole.states[0, : end + 1])


def test_progress_ends_with_the_flight() -> None:
    """The last report of progress says that all is done, also of a flight that ends early."""
    reports: list[tuple[float, float]] = []
    march(
        Sampled(),
        TICKS,
        over=lambda rows: rows.states[:, :, 0] < 0.3,
        window=2,
        progress=lambda done, total, what="", /: reports.append((done, total)),
    )
    assert reports[0] == (2, TICKS)
    assert reports[-1] == (TICKS, TICKS)


def test_saturation_keeps_what_is_within_and_limits_each_entry() -> None:
    """Each entry has its own limits, which may be infinite."""
    u = ca.SX.sym("u", 3)
    lowest = np.array([-1.0, -np.inf, 0.5])
    limited = ca.Function("limited", [u], [saturated(u, lowest, np.array([1.0, 2.0, np.inf]))])
    for given in np.random.default_rng(0).normal(scale=3.0, size=(20, 3)):
        expected = np.clip(given, lowest, [1.0, 2.0, np.inf])
        np.testing.assert_array_equal(np.array(limited(given)).ravel(), expected)
