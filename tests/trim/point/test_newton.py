"""Newton's method for many trims: in Python and C, with singular, scaled and bounded equations."""

from __future__ import annotations

import numpy as np
import pytest
from own_models import F16

from hfa import Model, Signal
from trim.point.condition import TrimCondition, usual_condition
from trim.point.halving import newton, newton_step
from trim.point.system import TrimSystem
from trim.sweeps.points import _starts

SPEEDS = np.linspace(150.0, 700.0, 40)


def f16_system() -> TrimSystem:
    """Return the equations of a straight trim of the F-16 with 12 unknowns and a given speed."""
    return TrimSystem(F16, usual_condition(F16), ("speed",))


def circle(scale: float) -> tuple[Model, TrimCondition]:
    """Return a model and its trim with the equations x² + y² = 4 and 1e3 (x - y) = 0.

    scale: nominal size of the second equation
    """

    def equations(x, u, p, w):
        return {"x": x.x**2 + x.y**2 - 4, "y": 1e3 * (x.x - x.y)}, {}

    states = {"x": Signal(start=0.1, min=-5.0, max=5.0), "y": Signal(start=3.0, rate=scale)}
    model = Model("circle", states, {"u": Signal()}, equations, trim={"u": 0.0})
    return model, usual_condition(model)


def test_points_alone_and_together_give_equal_results() -> None:
    """Newton's method gives the same result for a point alone and among forty points."""
    system = f16_system()
    c = system.constants(len(SPEEDS), {"speed": SPEEDS})
    start = np.tile(system.start, (len(SPEEDS), 1))
    together, settled = newton(system, start, c)
    assert settled.sum() >= 38
    for i in np.flatnonzero(settled)[::7]:
        alone, _ = newton(system, start[i : i + 1], c[i : i + 1])
        np.testing.assert_array_equal(alone[0], together[i])
    residual, _ = system.residuals(together[settled], c[settled])
    assert np.abs(residual).max() < 1e-12


@pytest.mark.parametrize(
    ("names", "highest", "error"),
    [(("speed",), [700.0], 1e-6), (("speed", "altitude"), [700.0, 2e4], 1e-3)],
)
def test_searches_begin_at_taylor_polynomials(
    names: tuple[str, ...], highest: list[float], error: float
) -> None:
    """The median error is 8e-8 with quadratic terms, 2e-5 without, and .6 from the usual start."""
    system = TrimSystem(F16, usual_condition(F16).freed_for(names), names)
    lowest = [300.0, 0.0][: len(names)]
    values = np.random.default_rng(3).uniform(lowest, highest, (60, len(names)))
    starts = _starts(system, names, values)
    constants = system.constants(len(values), dict(zip(names, values.T, strict=True)))
    ends, settled = newton(system, starts, constants)
    assert settled.all()
    assert np.median(np.abs(ends - starts).max(axis=1)) < error


def test_bounded_steps_remain_within_the_limits() -> None:
    """With `bounded`, Newton's method remains within the limits of the unknowns.

    Without `bounded`, the solution is beyond the limits.
    """
    model, condition = circle(1.0)
    bounded = TrimCondition(model, condition.imposed, limits={"x": (0.0, 5.0)})
    system = TrimSystem(model, bounded)
    begin = np.array([[0.05, -0.1]])
    anywhere, _ = newton(system, begin, system.constants())
    within, _ = newton(system, begin, system.constants(), bounded=True)
    np.testing.assert_allclose(anywhere, -np.sqrt([[2.0, 2.0]]), rtol=1e-12)
    assert within[0, 0] >= 0.0


def test_a_singular_step_has_the_least_norm() -> None:
    """The Newton step for a singular Jacobian has the least norm. The step for nan is nan."""
    jacobians = np.array(
        [[[1.0, 1.0], [2.0, 2.0]], [[1.0, 0.0], [0.0, 2.0]], np.full((2, 2), np.nan)]
    )
    steps = newton_step(jacobians, np.array([[2.0, 4.0], [3.0, 4.0], [1.0, 1.0]]))
    np.testing.assert_allclose(steps[:2], [[-1.0, -1.0], [-3.0, -2.0]], rtol=1e-12)
    assert np.isnan(steps[2]).all()
