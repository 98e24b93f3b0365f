"""The two methods of the simulation loop: they agree where both work, stop on request, and report where they end."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from controller.flight.integrator import BackwardDifferentiation, RungeKutta, integrate
from hfa_support import NoSolutionError


def pendulum(fast: float) -> ca.Function:
    """A damped pendulum pushed by p, and an observer of its angle with a mode at -fast."""
    t, y, p = ca.SX.sym("t"), ca.SX.sym("y", 3), ca.SX.sym("p", 1)
    rate = ca.vertcat(y[1], -ca.sin(y[0]) - 0.3 * y[1] + p * ca.sin(t), fast * (y[0] - y[2]))
    return ca.Function("rate", [t, y, p], [rate])


def pushed(tick: int) -> np.ndarray:
    return np.array([0.5 if tick < 37 else -1.0])


def test_both_methods_agree_where_the_constants_jump_too() -> None:
    start, rate = np.array([1.0, 0.0, 0.0]), pendulum(4.0)
    stiff = integrate(BackwardDifferentiation(rate, 0.02, 5), start, pushed, 300)
    plain = integrate(RungeKutta(rate, 0.02, 5), start, pushed, 300)
    np.testing.assert_allclose(stiff, plain, atol=2e-5)
    np.testing.assert_allclose(plain[:, 0], 0.02 * np.arange(1501))


def test_from_rest_a_push_that_comes_later_is_not_stepped_over() -> None:
    """Once a gust that began after a second at rest was missed: the steps of the stiff method had grown by then."""
    t, y, p = ca.SX.sym("t"), ca.SX.sym("y", 2), ca.SX.sym("p", 1)
    push = ca.if_else(ca.fabs(t - 6.0) < 1.0, 1.0 + ca.cos(np.pi * (t - 6.0)), 0.0)
    rate = ca.Function("rate", [t, y, p], [ca.vertcat(push - y[0], 1e3 * (y[0] - y[1]))])
    path = integrate(BackwardDifferentiation(rate, 0.02, 1), np.zeros(2), lambda tick: np.zeros(1), 600)
    plain = integrate(RungeKutta(rate, 0.002, 10), np.zeros(2), lambda tick: np.zeros(1), 600)
    np.testing.assert_allclose(path[:, 1:], plain[::10, 1:], atol=1e-4)
    assert path[:, 1].max() > 0.5


@pytest.mark.parametrize("method", [RungeKutta, BackwardDifferentiation])
def test_a_run_ends_with_the_tick_that_is_told(method) -> None:
    def stop(rows: np.ndarray, p: np.ndarray) -> bool:
        return bool(rows[-1, 0] > 4.15)

    fast = 1e5 if method is BackwardDifferentiation else 4.0
    path = integrate(method(pendulum(fast), 0.02, 5), np.array([1.0, 0.0, 1.0]), pushed, 300, stop=stop)
    assert path[-1, 0] == pytest.approx(4.2)
    if method is BackwardDifferentiation:
        np.testing.assert_allclose(path[:, 3], path[:, 1], atol=3e-5)  # the fast mode follows


def test_what_is_kept_of_a_run_is_what_its_rows_say() -> None:
    rate = pendulum(4.0)
    whole = integrate(RungeKutta(rate, 0.02, 5), np.array([1.0, 0.0, 0.0]), pushed, 300)
    now, p, later, kept = (ca.SX.sym(name, size) for name, size in (("now", 4), ("p", 1), ("later", 4), ("kept", 2)))
    largest = ca.vertcat(ca.fmax(kept[0], now[1]), ca.fmax(kept[1], later[0]))
    method = RungeKutta(rate, 0.02, 5, after_step=ca.Function("largest", [now, p, later, kept], [largest]))
    path = integrate(method, np.array([1.0, 0.0, 0.0, -np.inf, -np.inf]), pushed, 300)
    assert path.shape == (2, 6)
    np.testing.assert_array_equal(path[-1, 1:4], whole[-1, 1:])
    assert path[-1, 4:].tolist() == [whole[:-1, 1].max(), pytest.approx(30.0)]


def test_a_loop_that_blows_up_says_when_and_nothing_else(capfd: pytest.CaptureFixture[str]) -> None:
    y = ca.SX.sym("y", 1)
    blown = ca.Function("rate", [ca.SX.sym("t"), y, ca.SX.sym("p", 0)], [y**2])
    for method, when in ((RungeKutta(blown, 0.05, 2), "1"), (BackwardDifferentiation(blown, 0.05, 2), r"0\.9")):
        with pytest.raises(NoSolutionError, match=rf"left every bound at t = {when}"):
            integrate(method, np.ones(1), lambda _: np.zeros(0), 2000)
    assert capfd.readouterr() == ("", "")
