"""Loops with very fast modes: backward differentiation agrees with Runge-Kutta where both can go."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from controller.flight.integrator import integrate, integrate_stiff
from hfa_support import NoSolutionError


def pendulum(fast: float) -> ca.Function:
    """A damped pendulum pushed by p, and an observer of its angle with a mode at -fast."""
    t, y, p = ca.SX.sym("t"), ca.SX.sym("y", 3), ca.SX.sym("p", 1)
    rate = ca.vertcat(y[1], -ca.sin(y[0]) - 0.3 * y[1] + p * ca.sin(t), fast * (y[0] - y[2]))
    return ca.Function("rate", [t, y, p], [rate])


def pushed(tick: int) -> np.ndarray:
    return np.array([0.5 if tick < 37 else -1.0])


def test_both_methods_agree_where_the_constants_jump_too() -> None:
    given = {"step": 0.02, "steps_per_tick": 5, "ticks": 300}
    stiff = integrate_stiff(pendulum(4.0), np.array([1.0, 0.0, 0.0]), pushed, **given)
    plain = integrate(pendulum(4.0), np.array([1.0, 0.0, 0.0]), pushed, **given, compile_code=False)
    np.testing.assert_allclose(stiff.times, plain.times)
    np.testing.assert_allclose(stiff.states, plain.states, atol=2e-5)


def test_a_fast_mode_follows_and_the_flight_ends_with_the_tick_that_is_told() -> None:
    def stop(times: np.ndarray, rows: np.ndarray, p: np.ndarray) -> bool:
        return bool(times[-1] > 4.15)

    path = integrate_stiff(
        pendulum(1e5), np.array([1.0, 0.0, 1.0]), pushed, step=0.02, steps_per_tick=5, ticks=300, stop=stop
    )
    assert path.times[-1] == pytest.approx(4.2)
    np.testing.assert_allclose(path.states[:, 2], path.states[:, 0], atol=3e-5)


def test_a_loop_that_blows_up_says_when_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    y = ca.SX.sym("y", 1)
    blown = ca.Function("rate", [ca.SX.sym("t"), y, ca.SX.sym("p", 0)], [y**2])
    with pytest.raises(NoSolutionError, match=r"left every bound at t = 0\.9 s"):
        integrate_stiff(blown, np.ones(1), lambda _: np.zeros(0), step=0.05, steps_per_tick=2, ticks=20)
    assert capfd.readouterr() == ("", "")
