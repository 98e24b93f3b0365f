"""Obstacles to a set, and the loops in which they are found, compared with closed forms."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from small_loops import P, T, V, cubic, limited_loop

from hfa_aircraft.march.ending import FAR, FAR_OF_STARTS, Outcome
from hfa_aircraft.model import Model, Signal
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search import obstacles
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.invariant import DisturbedLoop, _bisected, _falls
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import (
    LevelSet,
    first_obstacle,
    obstacles_around,
    rises,
    starts_by_outcome,
)
from hfa_prove.search.shape_boxes import Shape
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import Limits


@pytest.mark.parametrize(("values", "binds"), [
    ((-0.96, 1.0), False), ((-0.98, 1.0), True), ((-0.5, 1.93), False), ((-0.5, 1.95), True),
])  # fmt: skip
def test_a_limit_that_the_set_touches_at_either_end_binds(
    values: tuple[float, float], binds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A limit binds if the set reaches 97 % of the distance to its lowest or highest value."""
    signals = {"far": (np.array([-0.1, 0.1]), -1.0, 2.0), "x": (np.array(values), -1.0, 2.0)}

    def signals_at(edge: np.ndarray) -> Any:
        assert V(edge) == pytest.approx(0.5)
        return signals

    loop = cast(Any, SimpleNamespace(limited_signals=signals_at))
    far, near = np.array([1.0, 1.0]), np.array([0.5, 1.0])
    starts = {Outcome.LEFT: np.array([far, near, 2.0 * far])}

    def flown(loop: Any, proved: Any, rays: np.ndarray, clock: Any) -> Any:
        assert np.linalg.norm(np.linalg.solve(T, rays.T), axis=0) == pytest.approx(1.0)
        return starts

    monkeypatch.setattr(obstacles, "starts_by_outcome", flown)
    proved = LevelSet(V, 0.5, T)
    found = obstacles_around(loop, proved, (0.5, near), Clock(60.0))
    assert found.limits == (("x",) if binds else ())
    assert (found.rises[0], found.simulated) == (0.5, True)
    level, place = found.starts[Outcome.LEFT]
    assert level == V(near[None])[0]
    assert np.array_equal(place, near)


def test_an_obstacle_simulation_may_end_early(monkeypatch: pytest.MonkeyPatch) -> None:
    def ended(*arguments: Any) -> Any:
        raise OutOfTimeError("flights", 0.0)

    monkeypatch.setattr(obstacles, "starts_by_outcome", ended)
    loop = cast(Any, SimpleNamespace(limited_signals=lambda edge: {}))
    found = obstacles_around(loop, LevelSet(V, 1.0, T), (np.inf, None), Clock(60.0))
    assert (found.simulated, found.starts) == (False, {})


@pytest.mark.parametrize("quick", [False, True])
def test_the_first_obstacle_is_the_lowest_point_of_v(quick: bool) -> None:
    """On the half-plane a'z >= 1, z'P z is lowest at z = P⁻¹a / (a'P⁻¹a), with 1 / (a'P⁻¹a)."""
    a = np.array([0.9, 0.7])
    lowest = 1.0 / (a @ np.linalg.solve(P, a))
    level, place = first_obstacle(lambda z: z @ a >= 1.0, V, 2.0 * T, quick=quick)
    assert place is not None
    assert lowest <= level == pytest.approx(lowest, rel=2e-3)
    assert level == V(place[None])[0]
    assert 1.0 <= a @ place < 1.001
    assert first_obstacle(lambda z: z @ a >= 50.0, V, T, quick=quick) == (np.inf, None)


def test_the_first_obstacle_of_each_ray_is_found() -> None:
    """The factor is that of the nearest boundary, within the bisections, or inf without any."""
    rays = np.array([[1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [0.0, 0.03]])
    radii = np.linspace(0.1, 1.0, 10)

    def is_obstacle(z: np.ndarray) -> np.ndarray:
        return np.asarray((z[:, 0] >= 0.73) & (z[:, 0] < 1.3) | (z[:, 1] >= 0.02))

    found = obstacles._along(is_obstacle, rays, radii)
    assert found == pytest.approx([0.73, 0.02, 0.365, 0.02 / 0.03], abs=0.1 / 2**11)
    assert np.all(is_obstacle(found[:, None] * rays))
    none = obstacles._along(lambda z: np.zeros(len(z), bool), rays, radii)
    assert np.all(none == np.inf)


def test_a_set_has_its_volume_and_its_points() -> None:
    """The size is that of the ellipsoid; only points within level and unit ball are contained."""
    proved = LevelSet(V, 0.7, T)
    assert proved.size == pytest.approx((0.7**2 / np.linalg.det(P)) ** 0.25, rel=0.02)
    assert LevelSet(V, 1e9, T).size == 0.0
    z = np.random.default_rng(0).uniform(-2.0, 2.0, (500, 2))
    level = np.einsum("ki,ij,kj->k", z, P, z)
    y = np.linalg.norm(z @ np.linalg.inv(T).T, axis=1)
    assert np.array_equal(proved.contains(z), (level <= 0.7) & (y <= 1.0))
    small = LevelSet(V, 0.7, 0.2 * T)
    assert np.array_equal(small.contains(z), (level <= 0.7) & (y <= 0.2))
    wave = PolynomialFunction.of_terms([(4.0, (2,)), (-1.0, (4,))])  # highest, 4, at z² = 2
    line = LevelSet(wave, 1.0, np.eye(1))
    assert line.level(np.array([[1.0], [2.0]])) == pytest.approx([3.0, 4.0], rel=2e-3)


def test_the_nearest_diverging_and_leaving_starts_are_found() -> None:
    """x' = -x + x³ diverges from |x| > 1 and leaves the limit 0.8 before."""
    square = PolynomialFunction.quadratic(np.eye(1))
    proved = LevelSet(square, 0.25, 0.5 * np.eye(1))
    rays = np.array([[0.5], [-0.5]])
    found = starts_by_outcome(cubic({"x": (-np.inf, 0.8)}), proved, rays, Clock(60.0))
    ((left,),) = found[Outcome.LEFT]
    ((lost,),) = found[Outcome.DIVERGED]
    assert 0.8 < left < 0.85
    assert -1.06 < lost < -1.0
    assert set(found) == {Outcome.LEFT, Outcome.DIVERGED}
    with pytest.raises(OutOfTimeError):
        starts_by_outcome(cubic({}), proved, rays, Clock(-1.0))


def test_starts_cover_the_surroundings_of_the_set(monkeypatch: pytest.MonkeyPatch) -> None:
    """Flights last 12 slowest time constants, from the edge of the set to 20 times its distance."""
    model = Model(
        "two", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": -0.5 * x.a, "b": -4.0 * x.b}, {}), trim={},
    )  # fmt: skip
    loop = LoopValues(Loop(model, {}, {"a": 0.0, "b": 0.0}, {}, {}, {}, Gain(np.zeros((0, 2)))))
    proved = LevelSet(PolynomialFunction.quadratic(np.diag([4.0, 0.01])), 1.0, np.eye(2))
    tried: list[np.ndarray] = []

    def outcomes(loop: Any, starts: np.ndarray, holds: Any, seconds: float, clock: Any) -> Any:
        tried.append(starts)
        assert seconds == pytest.approx(24.0)
        return np.full(len(starts), Outcome.ELSEWHERE, dtype=object)

    monkeypatch.setattr(obstacles, "outcomes", outcomes)
    found = starts_by_outcome(loop, proved, np.eye(2), Clock(60.0))
    distances = np.linalg.norm(tried[0], axis=1).reshape(10, 2)
    share = np.linspace(0.1, 1.0, 10)[:, None] ** 2
    edge = np.array([0.5, 1.0])  # b reaches the level beyond the unit ball
    assert distances == pytest.approx(edge + 19.0 * edge * share)
    assert set(found) == {Outcome.DIVERGED}
    assert len(tried) == 2
    assert np.linalg.norm(obstacles._unit(np.array([[3.0, 4.0], [0.1, 0.0]])), axis=1) == (
        pytest.approx(1.0)
    )


def test_a_flight_diverges_beyond_its_start_and_many_nominal_values(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bounds: list[np.ndarray] = []
    rule = obstacles.EndRule

    def recorded(far: np.ndarray, *others: Any) -> Any:
        bounds.append(far)
        return rule(far, *others)

    monkeypatch.setattr(obstacles, "EndRule", recorded)
    starts = np.array([[1.0, 1e9], [-2.0, 1.0]])
    free = LoopValues(Loop(**{**vars(limited_loop().loop), "limits": {}}))
    obstacles.outcomes(free, starts, lambda z: np.ones(len(z), bool), 1.0, Clock(60.0))
    assert bounds[0].tolist() == [FAR * 2.0, FAR_OF_STARTS * 1e9]


def test_v_rises_where_its_derivative_is_not_negative() -> None:
    """V' = 2 x (x³ - x) is negative for 0 < |x| < 1, and an undefined V' counts as a rise."""
    square = PolynomialFunction.quadratic(np.eye(1))
    z = np.array([[0.0], [0.5], [-0.999], [1.001], [-2.0], [np.nan]])
    rising = rises(cubic({}), square.slope)(z)
    assert rising.tolist() == [True, False, False, True, True, True]


def test_limited_signals_are_deviations_from_the_equilibrium() -> None:
    values = limited_loop()
    z = np.array([[0.0, 0.0], [1.0, 1.0], [0.0, 2.5], [-1.0, -3.5], [0.5, 0.5]])
    assert values.limited == ("b", "y")
    assert np.array_equal(values.permitted_deviations, [[-3.0, 2.0], [-np.inf, 4.0]])
    signals = values.limited_signals(z)
    b, low, high = signals["b"]
    assert np.array_equal(b, z[:, 1])
    assert (low, high) == (-3.0, 2.0)
    y = (1.0 + z[:, 0]) ** 2 + 3.0 * (2.0 + z[:, 1]) - 7.0
    assert signals["y"][0] == pytest.approx(y)
    assert values.beyond(z).tolist() == [False, True, True, True, False]
    assert np.allclose(values.J, [[-1.0, 0.0], [1.0, -2.0]])
    assert np.allclose(values.limited_rows, [[0.0, 1.0], [2.0, 3.0]])
    assert np.allclose(
        values.rates(z), np.column_stack([-1.0 - z[:, 0], z[:, 0] - 3.0 - 2.0 * z[:, 1]])
    )
    assert values.nominal.tolist() == [2.0, 3.0]
    far = np.array([[-1.01 * FAR * 2.0, -1.0], [-0.99 * FAR * 2.0, -1e9], [np.nan, 0.0]])
    free = LoopValues(Loop(**{**vars(values.loop), "limits": {}}))
    assert free.away(far).tolist() == [True, True, True]
    assert free.away(np.array([[-0.99 * FAR * 2.0, 0.0]])).tolist() == [False]
    assert values.away(z).tolist() == values.beyond(z).tolist()


def test_the_worst_disturbance_raises_v_fastest() -> None:
    """Of all ends of the disturbances, none gives a higher V' at a state."""
    model = Model(
        "gusty", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: (
            {"a": -x.a + w.first * (1.0 + x.b) + w.second, "b": -x.b - 0.5 * w.second}, {},
        ),
        disturbances={"first": Signal(), "still": Signal(), "second": Signal()}, trim={},
    )  # fmt: skip
    sizes = {"first": 0.2, "second": 0.3}
    loop = Loop(model, {}, {"a": 1.0, "b": -0.5}, {}, {}, {}, Gain(np.zeros((0, 2))), sizes)
    disturbed = DisturbedLoop(loop, V)
    z = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 2))
    a, b = (z + np.array([1.0, -0.5])).T
    rises = []
    for first in (-0.2, 0.2):
        for second in (-0.3, 0.3):
            rates = np.column_stack([-a + first * (1.0 + b) + second, -b - 0.5 * second])
            rises.append(np.sum(V.slope(z) * rates, axis=1))
    found = np.sum(V.slope(z) * disturbed.rates(z), axis=1)
    assert found == pytest.approx(np.max(rises, axis=0))


def test_the_highest_falling_level_is_bisected() -> None:
    """x' = -x + x³ + w with |w| <= 0.2: V' < 0 on x² = c between the roots of x - x³ = 0.2."""
    model = Model(
        "cubic", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": x.x**3 - x.x + w.w}, {}),
        disturbances={"w": Signal()}, trim={},
    )  # fmt: skip
    square = PolynomialFunction.quadratic(np.eye(1))
    roots = np.sort(np.roots([1.0, 0.0, -1.0, 0.2]).real)[1:] ** 2
    for limits, highest in (({}, roots[1]), ({"x": (-0.6, 0.7)}, 0.36)):
        loop = Loop(
            model, {}, {"x": 0.0}, {}, {}, limits, Gain(np.zeros((0, 1))), {"w": 0.2}
        )  # fmt: skip
        plant = DisturbedLoop(loop, square)
        one = 2.0 * np.eye(1)
        assert [_falls(plant, square, one, level)[0] for level in (0.9 * roots[0], 0.3, 0.9)] == [
            False, True, False,
        ]  # fmt: skip
        low, above = _bisected(plant, square, one, highest / 1.2)
        assert low <= highest <= above
        assert above / low == pytest.approx((2000.0 ** (1.0 / 29.0)) ** (1.0 / 16.0))
        _, place = _falls(plant, square, one, 0.9)
        assert (place is None) == (limits != {} and roots[1] > 0.9)


@pytest.mark.parametrize(
    ("limits", "level", "rises"), [({}, 1.0, True), ({"a": (-9.0, 0.5)}, 0.25, False)]
)
def test_the_bound_of_a_shape_is_its_first_obstacle(
    limits: Limits, level: float, rises: bool
) -> None:
    """For a' = a³ - a and b' = b³ - b, V = a² + b² is first obstructed at |a| = 1 or a limit."""
    model = Model(
        "cubics", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": x.a**3 - x.a, "b": x.b**3 - x.b}, {}), trim={},
    )  # fmt: skip
    still = {"a": 0.0, "b": 0.0}
    samples = LoopValues(Loop(model, {}, still, {}, {}, limits, Gain(np.zeros((0, 2)))))
    shape = Shape.of_matrix(np.eye(2), -np.eye(2), 2)
    for quick in (False, True):
        found = shape.bound(samples, 4.0, quick=quick)
        assert level <= found.level == pytest.approx(level, rel=0.1 if quick else 0.01)
        assert found.rises is rises
        assert found.place is not None
        assert shape.values(found.place[None])[0] == pytest.approx(found.level, rel=1e-6)
    assert shape.bound(samples, 0.8 * level) == (np.inf, None, False)
