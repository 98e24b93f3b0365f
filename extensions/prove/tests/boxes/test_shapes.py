"""Sets of the search on boxes: their forms, extents and growth."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from small_loops import J, P, cubic

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cover import OpenBoxError, RefutedError, SmallestBoxError
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search import region_boxes, shape_boxes
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import (
    RegionProblem,
    Settings,
)
from hfa_prove.search.shape_boxes import Growth, Shape
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial


def test_a_set_on_boxes_is_reduced_to_the_state_limits() -> None:
    """The set of a V is scaled in length by a share, and within the limits of the states."""
    shape = Shape.of_matrix(np.diag([1.0, 1.0]), np.diag([-1.0, -2.0]), 2)
    at = cast(Any, SimpleNamespace(x=np.zeros(2)))
    for limit, share, end in ((9.0, 0.5, 0.5), (9.0, 0.25, 0.25), (0.2, 0.5, 0.2), (0.2, 0.1, 0.1)):
        ends = np.array([[-9.0, limit], [-9.0, 9.0]])
        loop = SimpleNamespace(states=("a", "b"), ends={("a", "b"): ends}.get)
        search = cast(Any, SimpleNamespace(J=np.diag([-1.0, -2.0]), loop=loop, equilibrium=at))
        (low, high), _ = BoxesSearch._part(search, shape, share).extents().ends
        assert (-low, high) == pytest.approx((end, end), rel=1e-2)
        assert high <= limit


def quartic_shape() -> Shape:
    """Return V = z'P z + 0.3 a⁴ - 0.1 a b³, in coordinates that are not those of its proof."""
    in_z = PolynomialFunction.of_terms(
        [(2.0, (2, 0)), (1.0, (1, 1)), (1.0, (0, 2)), (0.3, (4, 0)), (-0.1, (1, 3))]
    )
    M = np.array([[1.0, 0.25], [-0.5, 0.75]])
    V = in_z.substituted(np.linalg.inv(M))
    return Shape.of_piece(Piece(M, Polynomial(2, V.terms), 1.0), 4)


def test_a_shape_keeps_its_values_in_every_form() -> None:
    """Coordinates, degree and cube do not change V(z); a level divides it."""
    shape = quartic_shape()
    z = np.random.default_rng(0).uniform(-0.6, 0.6, (60, 2))
    a, b = z.T
    V = np.einsum("ki,ij,kj->k", z, P, z) + 0.3 * a**4 - 0.1 * a * b**3
    scaled = shape.of_level(0.5)
    for same in (
        shape, shape.diagonal(J), shape.in_cube(), shape.of_degree(6), scaled.of_level(2.0),
        shape.stretched(np.array([2.0, 0.3])), Shape.of_piece(shape.piece(), 2),
    ):  # fmt: skip
        assert same.values(z) == pytest.approx(V, abs=1e-9)
    assert scaled.values(z) == pytest.approx(2.0 * V)
    assert Shape.of_piece(Piece(np.eye(2), Polynomial(2, ((3.0, (2, 0)),)), 1.5), 2).values(z) == (
        pytest.approx(2.0 * a**2)
    )
    step = 1e-6 * np.eye(2)
    slopes = [(shape.values(z + each) - shape.values(z - each)) / 2e-6 for each in step]
    assert shape.gradients(z) == pytest.approx(np.column_stack(slopes), abs=1e-6)
    small = 1e-4 * z
    y = small @ shape.M.T
    falls = -np.sum(shape.gradients(small) * (small @ J.T), axis=1)
    assert np.einsum("ki,ij,kj->k", y, shape.linear_decay(J), y) == pytest.approx(falls, rel=1e-5)
    T_slow = shape.slow(J)
    assert np.allclose(T_slow.T @ shape.linear_decay(J) @ T_slow, np.eye(2), atol=1e-9)
    edge = shape.edge_points(300)
    assert shape.values(edge @ shape.N.T) == pytest.approx(1.0, rel=1e-6)
    cube = shape.in_cube()
    assert 0.4 < np.max(np.abs(cube.edge_points(300))) < 1.0
    inside = shape.values(z) <= 1.0
    level_set = shape.level_set()
    assert np.array_equal(level_set.contains(z), inside)
    turned = shape.diagonal(J)
    for form in (turned.square, turned.linear_decay(J)):
        assert np.allclose(form, np.diag(np.diag(form)), atol=1e-7)
    assert np.allclose(turned.square, np.eye(2), atol=1e-7)


def test_sizes_and_extents_of_an_ellipse_are_exact() -> None:
    """The volume is π / sqrt(det P), and z_i is at most sqrt(P⁻¹_ii); multipliers prove it."""
    shape = Shape.of_matrix(P, J, 2)
    assert shape.size() == pytest.approx(np.linalg.det(P) ** -0.25, rel=0.02)
    half = np.sqrt(np.diag(np.linalg.inv(P)))
    for tried, exact in ((shape, half), (quartic_shape(), None)):
        extents = tried.extents()
        if exact is not None:
            assert np.all(extents.ends[:, 1] >= exact)
            assert extents.ends == pytest.approx(np.column_stack([-exact, exact]), rel=1e-2)
        z = tried.edge_points(500) @ tried.N.T
        z = np.concatenate([z, 0.5 * z, 0.9 * z])
        room = 1.0 - tried.values(z)
        for i in range(2):
            for side, sign in enumerate((-1.0, 1.0)):
                proved_bound = sign * z[:, i] + extents.multipliers[i, side] * room
                assert np.max(proved_bound) <= sign * extents.ends[i, side]
        assert np.all(extents.multipliers > 0.0)


def test_rows_of_the_growth_are_its_inequalities() -> None:
    """Each row times the coefficients is -V' over the modal decay; beyond a limit it is V."""
    model = Model(
        "linear", {"a": Signal(), "b": Signal()}, {},
        lambda x, u, p, w: ({"a": -x.a, "b": -3.0 * x.b + 0.1 * x.a**2}, {}), trim={},
    )  # fmt: skip
    limits = {"a": (-np.inf, 0.4)}
    still = {"a": 0.0, "b": 0.0}
    samples = LoopValues(Loop(model, {}, still, {}, {}, limits, Gain(np.zeros((0, 2)))))
    shape = Shape.of_matrix(np.diag([4.0, 9.0]), samples.J, 2)
    decay = shape.modal_decay(samples.J)
    expected = np.diag([1.0 * 4.0, 3.0 * 9.0]) + shape_boxes._SLOWLY * 2.0 * np.diag([4.0, 9.0])
    assert decay == pytest.approx(expected, rel=1e-3, abs=1e-9)
    growth = Growth(samples, shape, lambda what: None)
    growth._decay = decay
    inside = growth._inside(shape, 0.5, 400)
    assert inside.shape == (400, 2)
    V = shape.V(inside)
    assert 0.45 < np.max(V) <= 0.5 + 1e-9
    edge = growth._edge(shape, 0.5, 50)
    assert shape.V(edge) == pytest.approx(0.5)
    y = np.concatenate([inside, edge, growth._edge(shape, 1.0, 50)])
    z = y @ shape.N.T
    rows, least = growth._rows(shape, y)
    found = rows @ shape.V.coefficients
    falls = -np.sum(shape.gradients(z) * samples.rates(z), axis=1)
    falls /= np.einsum("ki,ij,kj->k", z, decay, z)
    beyond = z[:, 0] > 0.4
    near = np.concatenate([np.zeros(450), np.full(50, 0.5)])  # V = 1 is halfway of 0.9 to 1.1
    leeway = shape_boxes._LEEWAY * near
    assert np.any(beyond)
    assert found == pytest.approx(np.where(beyond, shape.V(y), falls + leeway * shape.V(y)))
    assert least == pytest.approx(np.where(beyond, 1.02, shape_boxes._DECAY + leeway))
    linear = growth._linear_rows(shape, z[:20]) @ shape.V.coefficients
    of_J = -np.sum(shape.gradients(z[:20]) * (z[:20] @ samples.J.T), axis=1)
    assert linear == pytest.approx(of_J / np.einsum("ki,ij,kj->k", z[:20], decay, z[:20]))
    quartic = shape.of_degree(4)
    columns = growth._unknowns(quartic)
    is_square = quartic.V.degrees == 2
    assert columns.shape[1] == 1 + np.count_nonzero(~is_square)
    assert np.allclose(columns[is_square][:, 0], quartic.V.coefficients[is_square])
    assert not np.any(columns[is_square][:, 1:])
    assert np.array_equal(growth._unknowns(shape), np.eye(3))
    while growth.finer():
        pass
    assert growth._least_decay < shape_boxes._LEAST_DECAY


def test_the_largest_set_on_boxes_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A set that is not larger than the present one is neither stored nor saved."""
    saved: list[float] = []
    settings = Settings(2, Clock(60.0), lambda region: saved.append(region.set.size))
    loop = cubic({"x": (-2.0, 2.0)}).loop
    search = BoxesSearch(RegionProblem(loop), settings)

    def decrease(loop: Any, at: Any, piece: Piece, ends: Any, multipliers: Any) -> Any:
        return SimpleNamespace(piece=piece, proved=lambda most, clock: 7)

    monkeypatch.setattr("hfa_prove.search.region_boxes.Decrease", decrease)
    for share in (0.5, 0.25, 0.75):
        search._prove(Shape.of_matrix(np.eye(1) / share**2, -np.eye(1), 2), f"{share}")
    assert saved == pytest.approx([0.5, 0.75])
    best = search._best
    assert best is not None
    assert (best.origin, best.size, best.witness["boxes"]) == ("0.75", 7, 14)
    low, high = best.extents["x"]
    assert (-low, high) == pytest.approx((0.75, 0.75), rel=1e-2)
    assert best.statement.equilibrium == {"x": 0.0}
    assert best.rho == 1.0
    with pytest.raises(OutOfTimeError):
        BoxesSearch(RegionProblem(loop), Settings(2, Clock(-1.0)))._report("the first V")


def boxes_search(degree: int = 4) -> BoxesSearch:
    loop = cubic({"x": (-2.0, 2.0)}).loop
    return BoxesSearch(RegionProblem(loop), Settings(degree, Clock(60.0)))


@pytest.mark.parametrize("highest", [9.0, 0.9, 0.1, 0.0])
def test_the_first_levels_rise_or_are_halved(highest: float) -> None:
    """Shares rise until one fails. If the first fails, it is halved until one is proved."""
    search = boxes_search()
    tried: list[float] = []

    def is_proved(growth: Any, share: float, origin: str, time_share: float) -> bool:
        tried.append(share)
        return share <= highest

    search._is_proved = is_proved  # type: ignore[method-assign]
    search._first_levels(cast(Any, None), "a test")
    first, *rising = region_boxes._RISING
    if highest >= first:
        proved_shares = [share for share in rising if share <= highest]
        failed = rising[len(proved_shares) : len(proved_shares) + 1]
        assert tried == [first, *proved_shares, *failed]
        return
    halved = [first / 2.0**i for i in range(len(tried))]
    assert tried == halved
    end = tried[-1]
    if highest:
        assert end <= highest < 2.0 * end
    else:
        assert end / 2.0 < region_boxes._LEAST <= end


def test_a_later_level_is_tried_if_it_can_be_larger() -> None:
    """Falling shares are tried while their set would be larger than the largest proved one."""
    search = boxes_search()
    tried: list[float] = []
    most = [0.0]

    def is_proved(growth: Any, share: float, origin: str, time_share: float) -> bool:
        tried.append(share)
        return share <= most[0]

    search._is_proved = is_proved  # type: ignore[method-assign]
    growth = cast(Any, SimpleNamespace(shape=SimpleNamespace(size=lambda: 2.0)))
    search._best = cast(Any, "a set")
    falling = region_boxes._FALLING
    for highest, largest, found, shares in (
        (9.0, 0.1, True, falling[:1]),
        (falling[1], 0.1, True, falling[:2]),
        (0.0, 0.1, False, falling),
        (9.0, 2.0 * falling[0], True, ()),  # hardly larger: V grows on without a proof
        (0.0, 1.95 / region_boxes._LARGER, False, falling[:1]),
    ):
        most[0] = highest
        search._largest = largest
        tried.clear()
        assert search._later_level(growth, "a test") is found
        assert tuple(tried) == tuple(shares)
    search._best = None
    search._first_levels = lambda growth, origin: None  # type: ignore[method-assign]
    assert not search._later_level(growth, "a test")


@pytest.mark.parametrize(
    ("degree", "present", "grown"), [(4, 2, [2, 4, 4, 4]), (2, 2, [2, 2, 2]), (4, 4, [4, 4, 4])]
)
def test_sets_grow_with_rising_degree(degree: int, present: int, grown: list[int]) -> None:
    """V grows with degree 2, then with the highest degree, and there with finer decay."""
    search = boxes_search(degree)
    found: list[int] = []
    search._grow = lambda growth, degree: found.append(degree)  # type: ignore[method-assign]
    search._later_level = lambda growth, origin: True  # type: ignore[method-assign]
    finer = iter([True, True, False])
    shape = SimpleNamespace(V=SimpleNamespace(degree=present))
    search._enlarge(cast(Any, SimpleNamespace(shape=shape, finer=lambda: next(finer))))
    assert found == grown


def test_each_first_v_is_proved_and_grown(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search without a set proves first levels. With one, it begins with the V of that set."""
    shape = Shape.of_matrix(np.eye(1), -np.eye(1), 2)
    monkeypatch.setattr(
        region_boxes, "Growth", lambda samples, shape, report: SimpleNamespace(shape=shape)
    )
    for earlier in (None, 0.25):
        search = boxes_search()
        steps: list[tuple[str, float]] = []

        def level(step: str, steps: Any, growth: Any, *others: Any) -> None:
            steps.append((step, float(growth.shape.V.coefficients[0])))

        search._first_shapes = lambda: [("a", shape), ("b", shape.of_level(2.0))]  # type: ignore[method-assign]
        search._first_levels = partial(level, "first", steps)  # type: ignore[method-assign]
        search._enlarge = partial(level, "grown", steps)  # type: ignore[method-assign]
        if earlier is None:
            search._search()
            assert steps == [("first", 1.0), ("grown", 1.0), ("first", 0.5), ("grown", 0.5)]
            continue
        piece = shape.of_level(earlier).piece()
        statement = SimpleNamespace(piece=piece)
        search._best = cast(Any, SimpleNamespace(statement=statement, origin="known"))
        search._search()
        assert steps == [("grown", 4.0), ("grown", 1.0), ("grown", 0.5)]


def test_a_refuted_set_is_changed_and_proved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """The refuted point, in the units of the states, becomes a constraint of the next V."""
    search = boxes_search()
    shape = Shape.of_matrix(4.0 * np.eye(1), -np.eye(1), 2)
    search._part = lambda shape, share: shape  # type: ignore[method-assign]
    places: list[np.ndarray] = []

    def refuted(place: np.ndarray) -> Shape | None:
        places.append(place)
        return shape if len(places) < 3 else None

    growth = cast(Any, SimpleNamespace(shape=shape, refuted=refuted))
    errors: list[Exception] = []

    def prove(part: Shape, origin: str) -> None:
        if errors:
            raise errors.pop(0)

    search._prove = prove  # type: ignore[method-assign]
    errors[:] = [RefutedError("refuted", np.array([0.5]))]
    assert search._is_proved(growth, 0.5, "a test", 0.5)
    assert search._stopped == "no V with a larger set was found"
    assert np.abs(places[0]) == pytest.approx([0.25])
    errors[:] = [SmallestBoxError("small", np.array([0.5])), RefutedError("x", np.array([0.5]))]
    assert not search._is_proved(growth, 0.5, "a test", 0.5)
    assert search._stopped.startswith("V' >= 0 or a limit is exceeded at x ")
    assert search._stopped.endswith("in 0.5 of the set by samples")
    places.clear()
    errors[:] = [OpenBoxError("too many boxes", np.array([0.5]))]
    assert not search._is_proved(growth, 0.25, "a test", 0.5)
    assert search._stopped == "at 0.25 of the set by samples, linearly: too many boxes"


def test_a_new_v_replaces_the_present_one_if_its_set_is_large_enough() -> None:
    """After a refutation a set may shrink a little; to grow, it must become larger."""
    shape = Shape.of_matrix(np.eye(1), -np.eye(1), 2)
    growth = Growth(cubic({}), shape, lambda what: None)
    place = np.array([-0.5])
    levels: list[float] = []
    kept, gain = shape_boxes._KEPT**2, shape_boxes._GAIN**2
    fits: list[Shape | None] = []

    def good(level: float) -> Shape | None:
        levels.append(level)
        return fits.pop(0)

    growth._good = good  # type: ignore[method-assign]
    for fit, replaces in (
        (shape.of_level(1.01 * kept), True), (shape.of_level(0.99 * kept), False), (None, False),
    ):  # fmt: skip
        growth.shape = shape
        fits[:] = [fit]
        assert growth.refuted(place) is (fit if replaces else None)
        assert growth.shape is (fit if replaces else shape)
    assert levels == [1.0] * 3
    assert growth._refuted.shape == (93, 1)
    assert growth._refuted[0] == place
    assert np.all(np.abs(growth._refuted - place) < 0.1)
    levels.clear()
    growth.shape = shape
    larger = shape.of_level(1.01 * gain)
    fits[:] = [None, shape.of_level(0.99 * gain), larger]
    assert growth.grown() is larger
    assert growth.shape is larger
    assert levels == pytest.approx([share**2 for share in shape_boxes._GROWTHS[:3]])
    fits[:] = [None] * len(shape_boxes._GROWTHS)
    assert growth.grown() is None
    assert len(levels) == len(shape_boxes._GROWTHS) + 1
    growth.of_degree(4)
    assert growth.shape.V.degree == 4
    assert growth._growths == shape_boxes._GROWTHS
