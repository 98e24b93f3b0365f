"""The predefined-time law of one number, and the step that puts a residual on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from controller.laws.certified import after, decay_rate, fraction_to_reach

RATE, ETA = decay_rate(time=5.0, eta=0.8, theta=0.9), 0.8


@pytest.mark.parametrize("start", [1e-3, 0.5, 3.0, 40.0])
def test_step_is_exact(start: float) -> None:
    """Against an integration of y' = -k (y^(1-η) + y^(1+η)) by other means, before it settles."""
    from scipy.integrate import solve_ivp

    settle = math.atan(start**ETA) / (ETA * RATE)
    times = np.linspace(0.0, 0.9 * settle, 7)
    flow = solve_ivp(
        lambda _, y: -RATE * (y ** (1.0 - ETA) + y ** (1.0 + ETA)),
        (0.0, times[-1]),
        [start],
        t_eval=times,
        rtol=1e-11,
        atol=1e-15,
    )
    assert [after(start, RATE, ETA, t) for t in times] == pytest.approx(flow.y[0], rel=1e-7)


@pytest.mark.parametrize("start", [1e-30, 1e-3, 1.0, 1e8, 1e140, 1e200, 1e300])
@pytest.mark.parametrize("eta", [0.2, 0.8])
def test_zero_within_theta_T_from_anywhere(start: float, eta: float) -> None:
    rate = decay_rate(time=5.0, eta=eta, theta=0.9)
    assert after(start, rate, eta, 0.9 * 5.0 * (1.0 + 1e-12)) == 0.0
    assert 0.0 < after(start, rate, eta, 1e-12 * min(1.0, start**eta)) <= start


def test_bound_is_sharp() -> None:
    assert after(1e12, RATE, ETA, 0.9 * 5.0 * 0.999) > 0.0


def test_two_half_steps_are_one_step() -> None:
    assert after(after(7.0, RATE, ETA, 0.3), RATE, ETA, 0.4) == pytest.approx(after(7.0, RATE, ETA, 0.7), rel=1e-12)


def norm_at(f: float, parts: tuple[np.ndarray, np.ndarray, np.ndarray]) -> float:
    return float(np.linalg.norm(parts[0] + f * parts[1] + f * f * parts[2]))


def test_fraction_puts_the_residual_on_target() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        e = rng.normal(size=8)
        parts = (e, -e, -rng.normal(size=8) * 10.0 ** rng.uniform(-8.0, 0.0))
        start = norm_at(0.0, parts)
        lowest = min(norm_at(f, parts) for f in np.linspace(0.0, 1.0, 1001))
        target = lowest + (start - lowest) * rng.uniform(0.05, 0.999)
        f = fraction_to_reach(*parts, target)
        assert norm_at(f, parts) == pytest.approx(target, rel=1e-9)
        before = [norm_at(x, parts) for x in np.linspace(0.0, f, 200)[:-1]]
        assert min(before) > target * (1.0 - 1e-9)


def test_unreachable_target_gives_the_lowest_residual() -> None:
    e, b = np.array([1.0, 0.0]), np.array([0.0, 5.0])
    parts = (e, -e, -b)
    f = fraction_to_reach(*parts, target=1e-3)
    grid = np.linspace(1e-4, 1.0, 10_000)
    assert f == pytest.approx(grid[np.argmin([norm_at(x, parts) for x in grid])], abs=2e-4)


def test_without_curvature_and_target_zero_the_step_is_full() -> None:
    e = np.array([2.0, -1.0])
    assert fraction_to_reach(e, -e, np.zeros(2), target=0.0) == 1.0


def test_when_no_step_lowers_the_residual_the_step_is_full() -> None:
    e = np.array([1.0, 1.0])
    assert fraction_to_reach(e, 0.0 * e, 1e3 * e, target=0.5) == 1.0


def test_overflowing_residuals_give_the_full_step() -> None:
    huge = np.array([1e200, 1.0])
    with np.errstate(over="ignore", invalid="ignore"):
        assert fraction_to_reach(huge, -huge, huge, target=1.0) == 1.0
