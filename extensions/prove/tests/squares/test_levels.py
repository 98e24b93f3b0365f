"""Levels and polynomials of the search by sums of squares."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import casadi as ca
import numpy as np
import pytest
from small_loops import P, T, cubic, limited_loop

from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search import region_squares, shape_squares
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.level import LevelSearch, ball_of
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.region import PROVERS, provers_of
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import (
    RegionProblem,
    Settings,
    lyapunov_matrices,
    refuse_unstable,
)
from hfa_prove.search.region_squares import SquaresSearch, settings_of
from hfa_prove.search.squares import BASE, Terms, packed_monomials
from hfa_prove.statements.loop import Loop
from hfa_support.errors import BadInputError, NoSolutionError


def test_sums_of_squares_require_a_polynomial_policy() -> None:
    loop = cubic({}).loop
    z = ca.SX.sym("z")
    function = ca.Function("u", [z], [ca.SX(0, 1)])
    of_function = RegionProblem(Loop(**{**vars(loop), "policy": function}))
    assert (provers_of(RegionProblem(loop)), provers_of(of_function)) == (
        ("squares", "boxes"), ("boxes",),
    )  # fmt: skip
    with pytest.raises(BadInputError, match="polynomial policy; use --prover boxes"):
        PROVERS["squares"](of_function, Settings(2, Clock(60.0)))


def test_weights_give_their_lyapunov_matrices() -> None:
    """J'P + P J = -diag(w²), first with w = 1 / nominal and then within a factor of 10."""
    J = np.array([[-1.0, 2.0], [0.0, -3.0]])
    nominal = np.array([2.0, 0.5])
    first, *others = lyapunov_matrices(J, nominal, 20)
    assert np.allclose(J.T @ first + first @ J, -np.diag([0.25, 4.0]))
    assert len(others) == 19
    for each in others:
        weights = np.sqrt(-np.diag(J.T @ each + each @ J)) * nominal
        assert np.all((weights > 0.1) & (weights < 10.0))
    assert list(lyapunov_matrices(-J, nominal, 3)) == []


@pytest.mark.parametrize("mode", [0.0, 0.5])
def test_a_linearization_on_or_right_of_the_axis_is_refused(mode: float) -> None:
    refuse_unstable(-np.eye(2))
    with pytest.raises(NoSolutionError, match=f"{mode:.3g}"):
        refuse_unstable(np.diag([-1.0, mode]))


def test_a_clock_divides_the_time_that_is_left() -> None:
    """A step gets its share of the time that is left, and the whole is left after it."""
    clock = Clock(100.0)
    with clock.step(0.25):
        assert clock.left == pytest.approx(25.0, abs=1.0)
        with clock.step(0.5):
            assert clock.left == pytest.approx(12.5, abs=1.0)
    assert clock.left == pytest.approx(100.0, abs=1.0)
    assert 0.0 <= clock.used < 1.0
    with pytest.raises(OutOfTimeError, match=r"after fitting, 0\.75 of the cube undecided"):
        Clock(-1.0)(1.0, 4.0, "fitting")

    def interrupted(done: float, total: float, what: str = "") -> None:
        raise KeyboardInterrupt

    stopped = Clock(100.0, interrupted)
    with pytest.raises(KeyboardInterrupt):
        stopped(0.0, 1.0)
    assert stopped.interrupted


def test_the_first_level_touches_its_nearest_limit() -> None:
    """{z'P z <= c} reaches a limit g'z = d for c = d² / (g'P⁻¹g), the least c of all limits."""
    for limits, signal in (
        ({"b": (-1.0, 4.0)}, ((0.0, 1.0), 2.0)),
        ({"b": (1.5, 4.0)}, ((0.0, 1.0), 0.5)),
        ({"b": (-1.0, 4.0), "y": (-np.inf, 7.25)}, ((2.0, 3.0), 0.25)),
        ({"a": (0.9, np.inf), "b": (-1.0, 4.0)}, ((1.0, 0.0), 0.1)),
        ({}, ((1.0, 0.0), 200.0)),
    ):
        plant = LoopValues(Loop(**{**vars(limited_loop().loop), "limits": limits}))
        search = cast(Any, SimpleNamespace(plant=plant, _n=2))
        level, T = SquaresSearch._limit_of(search, P)
        g, distance = np.array(signal[0]), signal[1]
        exact = distance**2 / (g @ np.linalg.solve(P, g))
        assert exact > level == pytest.approx(exact, rel=1e-6)
        assert np.allclose(T.T @ P @ T, level * np.eye(2), rtol=1e-9)
        states = {name: pair for name, pair in limits.items() if name != "y"}
        loop = Loop(**{**vars(plant.loop), "limits": states})
        at = cast(Any, SimpleNamespace(x=np.array([1.0, 2.0])))
        boxes = cast(Any, SimpleNamespace(loop=loop, equilibrium=at, samples=plant))
        near = {
            name: min(abs(low - x), abs(high - x))
            for (name, x) in (("a", 1.0), ("b", 2.0))
            for low, high in (states.get(name, (-np.inf, np.inf)),)
        }
        wanted = [min(near["a"], 200.0), min(near["b"], 300.0)]
        get = BoxesSearch._limit_distances.fget  # type: ignore[attr-defined]
        assert get(boxes) == pytest.approx(wanted)


@pytest.mark.parametrize(("highest", "known"), [(0.37, 0.0), (0.37, 0.2), (1.0, 0.0), (0.0, 0.0)])
def test_the_largest_share_is_found_by_bisection(highest: float, known: float) -> None:
    """The share holds, and one that is larger by 0.04 % fails."""
    tried: list[float] = []

    def holds(share: float) -> bool:
        tried.append(share)
        return share <= highest

    found = LevelSearch.largest(cast(Any, SimpleNamespace(holds=holds)), known)
    assert found <= highest <= 1.0004 * found
    assert len(tried) < 20
    assert min(tried) >= known


def test_a_ball_holds_the_ellipsoid_closely() -> None:
    """The boundary of {z'P z <= 0.7} lies inside the unit ball of y, within 1 %."""
    T = ball_of(P, 0.7)
    angles = np.linspace(0.0, 2.0 * np.pi, 100)
    z = np.linalg.solve(np.linalg.cholesky(P).T, np.array([np.cos(angles), np.sin(angles)]))
    lengths = np.linalg.norm(np.linalg.solve(T, np.sqrt(0.7) * z), axis=0)
    assert np.all((lengths > 0.99) & (lengths < 1.0))


@pytest.mark.parametrize(
    ("n", "degree", "degrees"),
    [
        (1, 4, [2, 4]), (2, 2, [2]), (2, 6, [2, 4, 6]), (3, 2, [2, 2]), (4, 6, [2, 2, 4]),
        (5, 6, [2]), (6, 2, [2]),
    ],
)  # fmt: skip
def test_degrees_of_proofs_follow_from_the_number_of_states(
    n: int, degree: int, degrees: list[int]
) -> None:
    """With more states, V and its proofs have lower degrees. A proof contains V' in its degrees."""
    settings = settings_of(n, degree)
    assert [setting.degree for setting in settings] == degrees
    assert all(2 * setting.half >= setting.degree for setting in settings)
    assert all(setting.order >= 2 * setting.half - 1 for setting in settings)


def packed_value(terms: Terms, y: np.ndarray) -> float:
    """Return the value of a polynomial with packed exponents at a point y (n,)."""
    total = 0.0
    for key, value in zip(terms.keys.tolist(), terms.values.tolist(), strict=True):
        powers = [key // BASE**i % BASE for i in range(len(y))]
        total += value * float(np.prod(y ** np.array(powers)))
    return total


def test_polynomials_of_a_step_have_their_values() -> None:
    """Means over the unit ball, squares m'Q m, balls and limits are those of their formulas."""
    means = {
        1: {(2,): 1 / 3, (4,): 1 / 5, (3,): 0.0},
        2: {(2, 0): 1 / 4, (4, 0): 1 / 8, (2, 2): 1 / 24, (1, 1): 0.0, (1, 2): 0.0},
        3: {(2, 0, 0): 1 / 5, (0, 4, 0): 3 / 35, (2, 2, 0): 1 / 35},
    }
    for expected in means.values():
        found = shape_squares._means(np.array(list(expected)))
        assert found == pytest.approx(list(expected.values()))
    y = np.array([0.3, -0.7])
    Q = np.random.default_rng(0).normal(size=(6, 6))
    ones = np.ones(1)
    keys = packed_monomials(2, 0, 2)
    m = np.array([packed_value(Terms(np.array([key]), ones), y) for key in keys])
    assert sorted(m) == pytest.approx(sorted([1.0, *y, *y**2, y[0] * y[1]]))
    square = shape_squares._square(2, 0, 2, Q)
    assert packed_value(square, y) == pytest.approx(m @ Q @ m)
    assert packed_value(shape_squares._square(2, 1, 1, np.eye(2)), y) == pytest.approx(y @ y)
    assert shape_squares._degrees(square.keys).max() == 4
    ball = shape_squares._ball(2, 1.5)
    assert ball(y[None])[0] == pytest.approx(y @ y / 2.25 - 1.0)
    step = cast(Any, SimpleNamespace(search=SimpleNamespace(T=T), n=2))
    row = np.array([0.5, -2.0])
    signal = row @ T @ y
    for low, high in ((-3.0, 2.0), (-np.inf, 2.0), (-3.0, np.inf)):
        beyond = shape_squares._Step._beyond(step, row, low, high)
        least, most = max(low, -high), min(high, -low)
        if np.isfinite([low, high]).all():
            least, most = low, high
        expected = (signal - least) * (signal - most) / abs(least * most)
        assert packed_value(beyond, y) == pytest.approx(expected)


def test_v_is_improved_while_its_set_grows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each radius of the next set is tried until the size hardly grows or no proof is found."""
    search = SquaresSearch(cubic({}).loop, (), Settings(2, Clock(60.0)))
    square = PolynomialFunction.quadratic(np.eye(1))
    reaches: list[float] = []
    steps: dict[float, list[float | None]] = {1.35: [1.5, 2.0, 2.001], 1.1: [2.2, None]}
    sizes: list[float] = []
    kept: list[Any] = []

    def better(present: Any, rows: Any, room: Any, reach: float) -> Any:
        reaches.append(reach)
        following = steps[reach].pop(0)
        return None if following is None else square.scaled(following)

    def turn(V: PolynomialFunction, setting: Any, least: float = 0.0) -> Any:
        sizes.append(least)
        size = 1.0 if not reaches else float(V.coefficients[0])
        return SimpleNamespace(V=V, search=size, size=size, seconds=1e-3)

    monkeypatch.setattr(region_squares, "better", better)
    monkeypatch.setattr(region_squares, "accepted", lambda tried: tried)
    search._turn = turn  # type: ignore[method-assign]
    search._highest = lambda V: 1.0  # type: ignore[method-assign]
    search._kept = lambda level, origin: kept.append((level, origin)) or 1.0  # type: ignore
    found = search._climb(square, settings_of(1, 2)[0])
    assert found.coefficients[0] == 2.2
    assert reaches == [1.35, 1.35, 1.35, 1.1, 1.1]
    assert sizes == [0.0, 1.0, 1.5, 2.0, 2.001]
    assert kept == [(2.2, "a polynomial of degree 2 from the search")]
    proofs: list[float] = []
    search._prove = lambda V, rho, origin, setting: proofs.append(rho) or 1.0  # type: ignore
    search._highest = lambda V: 1.25  # type: ignore[method-assign]
    steps |= {1.35: [None], 1.1: [None]}
    search._climb(square, settings_of(1, 2)[0])
    assert proofs == [1.25]
    assert len(kept) == 1
    search._turn = lambda V, setting: None  # type: ignore[assignment, method-assign]
    assert search._climb(square, settings_of(1, 2)[0]) is square
