"""Enclosed functions of the checkers of regions and of cost bounds, compared with formulas.

The formulas are evaluated in doubles at random points.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cost import CostInequality, Ends, Guess, _least
from hfa_prove.check.cover import Boxes, RefutedError
from hfa_prove.check.equilibrium import Equilibrium, check_near
from hfa_prove.check.piece import OnPiece
from hfa_prove.check.region_boxes import Decrease
from hfa_prove.enclosure.taylor import lowest
from hfa_prove.fields import Rejected
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant

AT = {"a": 0.0, "b": 0.0}
INPUTS = {"u": 0.0, "v": 0.0}
ENDS = {"u": (-0.4, 0.3), "v": (-0.2, 0.5)}
LOW, HIGH = np.array(list(ENDS.values())).T


def _equations(x: Any, u: Any, p: Any, w: Any) -> Any:
    rates = {
        "a": -x.a + 0.5 * x.b * x.b + u.u + 0.3 * u.u * u.v,
        "b": x.a - 0.4 * x.b + u.v + 0.2 * x.a * u.u + 0.5 * u.v * u.v * u.v,
    }
    return rates, {"load": x.a + x.b * u.v}


MODEL = Model(
    "two inputs",
    {"a": Signal(), "b": Signal()},
    {name: Signal("1", 1.0, *ends) for name, ends in ENDS.items()},
    _equations,
    outputs={"load": Signal(min=-2.0, max=3.0)},
    trim={},
)
M = np.array([[0.75, -0.5], [0.5, 1.0]])
TERMS = ((1.0, (2, 0)), (0.5, (1, 1)), (1.5, (0, 2)), (0.25, (3, 1)))
PIECE = Piece(M, Polynomial(2, TERMS), 0.5)
Q = np.array([[1.0, 0.25], [0.25, 2.0]])
R = np.array([[1.0, 0.125], [0.125, 0.5]])
K = np.array([[0.5, 0.25], [-0.25, 0.5]])


class Places(NamedTuple):
    """Random points in boxes.

    boxes: the boxes
    s: (N, 2), position in the box, from -1 to 1
    y, z: (N, 2), coordinates and deviations at these points
    e: (N, 4), errors of the equilibrium
    """

    boxes: Boxes
    s: np.ndarray
    y: np.ndarray
    z: np.ndarray
    e: np.ndarray


def _places(radius: float, seed: int) -> Places:
    rng = np.random.default_rng(seed)
    count = 600
    depths = rng.integers(1, 5, (count, 2))
    half = np.ldexp(1.0, -depths)
    centres = (2.0 * np.floor(rng.uniform(0.0, 1.0, half.shape) / half) + 1.0) * half - 1.0
    s = rng.uniform(-1.0, 1.0, half.shape)
    s[: count // 2] = np.sign(s[: count // 2])  # the corners
    y = centres + half * s
    e = radius * np.sign(rng.normal(size=(count, 4)))
    return Places(Boxes(centres, depths), s, y, y @ np.linalg.inv(M).T, e)


def _equilibrium(radius: float, size: int) -> Equilibrium:
    return Equilibrium(np.zeros(size), np.full(size, radius))


def _gradient(y: np.ndarray) -> np.ndarray:
    """Return the gradient of W (N, 2) at y (N, 2)."""
    first, second = y.T
    return np.column_stack(
        [
            2.0 * first + 0.5 * second + 0.75 * first**2 * second,
            0.5 * first + 3.0 * second + 0.25 * first**3,
        ]
    )


def _rates(x: np.ndarray, inputs: np.ndarray) -> np.ndarray:
    a, b = x.T
    u, v = inputs.T
    rate_a = -a + 0.5 * b**2 + u + 0.3 * u * v
    rate_b = a - 0.4 * b + v + 0.2 * a * u + 0.5 * v**3
    return np.column_stack([rate_a, rate_b])


# The cost.


def _inequality(radius: float, share: float = 1.0) -> CostInequality:
    """Return the cost inequality of the function share W.

    radius: largest error of the equilibrium
    """
    plant = Plant(MODEL, {}, AT, INPUTS, {}, dict(ENDS))
    W = Polynomial(2, tuple((share * value, powers) for value, powers in TERMS))
    return CostInequality(plant, _equilibrium(radius, 4), PIECE._replace(W=W), Q, R)


def _g(places: Places, inputs: np.ndarray, share: float = 1.0) -> np.ndarray:
    rates = _rates(places.z + places.e[:, :2], inputs + places.e[:, 2:])
    falls = share * np.sum(_gradient(places.y) @ M * rates, axis=1)
    price = np.einsum("bi,ij,bj->b", places.z, Q, places.z)
    return falls + price + np.einsum("bi,ij,bj->b", inputs, R, inputs)


def _guess(inequality: CostInequality, boxes: Boxes, off: float) -> Guess:
    """Return a guess of the best inputs on boxes, with random errors of size `off`."""
    rng = np.random.default_rng(3)
    v, _ = inequality.best_inputs(boxes.centres @ np.linalg.inv(M).T)
    return Guess(v + off * rng.normal(size=v.shape), off * rng.normal(size=(*v.shape, 2)))


@pytest.mark.parametrize("radius", [0.0, 0.05])
@pytest.mark.parametrize("off", [0.0, 0.1])
def test_no_input_makes_the_inequality_smaller(radius: float, off: float) -> None:
    """The cost inequality g at a guess of the inputs is at least its proved lower bound.

    At any other input, g is at least this bound minus the loss.
    """
    places = _places(radius, 5)
    inequality = _inequality(radius)
    guess = _guess(inequality, places.boxes, off)
    bound = lowest(inequality._values.of(*inequality._inputs(places.boxes, guess)), 2)[0]
    guessed = guess.value + np.einsum("bmn,bn->bm", guess.slopes, places.s)
    assert np.all(_g(places, guessed) >= bound - 1e-12)
    loss = inequality._loss(places.boxes, guess)
    rng = np.random.default_rng(6)
    for corner in (LOW, HIGH, LOW * [1, 0] + HIGH * [0, 1], None, None, None):
        inputs = rng.uniform(LOW, HIGH, guessed.shape) if corner is None else corner + 0 * guessed
        assert np.all(_g(places, inputs) >= bound - loss - 1e-12)


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_the_curvature_is_below_all_second_derivatives(radius: float) -> None:
    """The enclosed curvature is a lower bound of the second derivatives at random points."""
    places = _places(radius, 7)
    inequality = _inequality(radius)
    count = len(places.s)
    limits = [np.broadcast_to(ends, (count, 2)) for ends in (LOW, HIGH)]
    curvature = inequality._curvature(places.boxes, *limits)
    rng = np.random.default_rng(8)
    slopes = _gradient(places.y) @ M
    for v in (LOW[1], HIGH[1], 0.0):
        cross = 0.3 * slopes[:, 0]
        bent = 3.0 * (v + places.e[:, 3]) * slopes[:, 1]
        for _ in range(5):
            d = rng.normal(size=(count, 2))
            second = 2.0 * np.einsum("bi,ij,bj->b", d, R, d)
            second += 2.0 * cross * d[:, 0] * d[:, 1] + bent * d[:, 1] ** 2
            assert np.all(second >= np.sum(curvature * d**2, axis=1) - 1e-12)


def test_the_inequality_is_satisfied_in_the_hole() -> None:
    """The inequality is satisfied at random points and inputs inside the hole."""
    share = 0.25
    places = _places(0.0, 9)
    reach = 2.0 ** -_inequality(0.0, share).hole
    scaled = places._replace(y=reach * places.s, z=reach * places.s @ np.linalg.inv(M).T)
    rng = np.random.default_rng(10)
    for size in (0.0, 0.01, 0.1, 1.0):
        inputs = size * rng.uniform(LOW, HIGH, places.s.shape)
        assert np.all(_g(scaled, inputs, share) >= -1e-14)


# Regions.


def _decrease(radius: float) -> Decrease:
    gain = Gain(K, {"u": ((0.25, (2, 0)),)})
    limits = {**ENDS, "load": (-2.0, 3.0)}
    loop = Loop(MODEL, {}, AT, INPUTS, {}, limits, gain)
    extents = np.array([[-0.7, 0.9], [-0.8, 0.6]])
    multipliers = np.array([[0.5, 0.25], [0.75, 1.0]])
    return Decrease(loop, _equilibrium(radius, 2), PIECE, extents, multipliers)


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_functions_of_a_region_are_above_their_bounds(radius: float) -> None:
    """Each function of a region is at least its lower bound on the boxes.

    The functions are -V', the distances of an output from its limits, and the distances of the
    states from their extents.
    """
    places = _places(radius, 11)
    decrease = _decrease(radius)
    bounds = lowest(decrease._functions.of(*decrease.symbols_on(places.boxes)), 2)
    x = places.z + places.e[:, :2]
    commands = -x @ K.T
    commands[:, 0] += 0.25 * x[:, 0] ** 2
    inputs = np.clip(commands, LOW, HIGH)
    falls = -np.sum(_gradient(places.y) @ M * _rates(x, inputs), axis=1)
    load = x[:, 0] + x[:, 1] * inputs[:, 1]
    room = PIECE.c - PIECE.W.at(places.y)
    found = [falls, load + 2.0, 3.0 - load]
    for i, ((low, high), (of_low, of_high)) in enumerate(
        zip(decrease.extents, decrease.multipliers, strict=True)
    ):
        z = places.z[:, i]
        found += [z - low - of_low * room, high - z - of_high * room]
    assert np.all(np.array(found) >= bounds - 1e-12)


@pytest.mark.parametrize("share", [-1e-9, 1e-9])
def test_boxes_outside_the_set_exceed_its_level(share: float) -> None:
    """A very small box is outside the set {W <= c} exactly if W exceeds c in the box."""
    place = np.array([0.5, 0.25])
    piece = PIECE._replace(c=float(PIECE.W.at(place[None])[0]) * (1.0 - share))
    small = Boxes(place[None], np.array([[40, 40]]))
    inequality = CostInequality(_inequality(0.0).plant, _equilibrium(0.0, 4), piece, Q, R)
    assert OnPiece.is_outside(inequality, small).tolist() == [share > 0.0]


def _small_box(y: tuple[float, float]) -> Boxes:
    return Boxes(np.array([y]), np.array([[20, 20]]))


@pytest.mark.parametrize("claim", ["region", "cost"])
def test_a_violated_inequality_is_refuted_at_a_point_of_the_set(claim: str) -> None:
    """A point of the set where an inequality is violated is returned, and none outside the set."""
    inside, outside = (0.25, 0.125), (0.75, 0.5)
    question: Any = _inequality(0.0, share=50.0)
    if claim == "region":
        question = replace(_decrease(0.0), extents=np.array([[-0.01, 0.01], [-0.01, 0.01]]))
    else:
        question = replace(question, piece=question.piece._replace(c=50.0 * PIECE.c))
    with pytest.raises(RefutedError) as refuted:
        question.edges(_small_box(inside))
    assert refuted.value.place.tolist() == list(inside)
    question.edges(_small_box(outside))


# Rounding, with rational numbers.


def _exact(value: Any) -> Fraction:
    return Fraction(float(np.ravel(value)[0]))


def test_the_lowest_value_of_a_parabola_is_not_rounded_up() -> None:
    """The lower bound of b d + c d² / 2 over low <= d <= high is at most the exact minimum."""
    rng = np.random.default_rng(12)
    b, c, first, second = rng.normal(size=(4, 300, 1))
    low, high = np.minimum(np.abs(first), np.abs(second)), np.maximum(np.abs(first), np.abs(second))
    high[::10] = low[::10]
    found = _least(b, c, Ends(low, high))
    assert _least(b, c, Ends(high + 1.0, low)).tolist() == np.zeros((300, 1)).tolist()
    for i in range(300):
        slope, bend, least, most = map(_exact, (b[i], c[i], low[i], high[i]))
        places = {least, most}
        if bend and least < -slope / bend < most:
            places.add(-slope / bend)
        exact = min(slope * d + bend * d * d / 2 for d in places)
        assert exact - Fraction(1, 10**13) <= _exact(found[i]) <= exact


def _pushed(R: np.ndarray, at: np.ndarray, radius: float, limits: Any) -> CostInequality:
    """Return the inequality of W = y² / 4, y = x, for x' = 0.1 u + 0.1 v."""
    inputs = {name: Signal(min=low, max=high) for name, (low, high) in limits.items()}

    def rates(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"x": 0.1 * u.u + 0.1 * u.v}, {}

    model = Model("pushed", {"x": Signal()}, inputs, rates, trim={})
    trim = dict(zip(("u", "v"), at[1:].tolist(), strict=True))
    plant = Plant(model, {}, {"x": float(at[0])}, trim, {}, dict(limits))
    piece = Piece(np.eye(1), Polynomial(1, ((0.25, (2,)),)), 0.5)
    return CostInequality(plant, Equilibrium(at, np.full(3, radius)), piece, np.eye(1), R)


def test_the_curvature_is_not_rounded_up() -> None:
    """The bounds of the curvature are at most 2 R_ii - 2 |R_ij|, of which doubles are not exact."""
    rng = np.random.default_rng(13)
    wide = {"u": (-1.0, 1.0), "v": (-1.0, 1.0)}
    box = Boxes(np.zeros((1, 1)), np.ones((1, 1), dtype=int))
    for scale in (1.0, 1e2, 1e4, 1e6, 1e8):
        a, b, cross = scale * rng.uniform(0.1, 1.0, 3)
        R = np.array([[a, cross], [cross, b]])
        inequality = _pushed(R, np.zeros(3), 0.0, wide)
        ends = np.array([[-1.0, -1.0]]), np.array([[1.0, 1.0]])
        for found, own in zip(inequality._curvature(box, *ends)[0], (a, b), strict=True):
            exact = 2 * _exact(own) - 2 * _exact(cross)
            assert exact - Fraction(scale) / 10**9 <= _exact(found) <= exact


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_the_ends_of_inputs_are_rounded_outward(radius: float) -> None:
    """The input deviations contain those from every enclosed equilibrium to both limits.

    An enclosed equilibrium beyond a limit is refused.
    """
    rng = np.random.default_rng(14)
    for _ in range(20):
        at = rng.uniform(-0.3, 0.3, 3)
        low, high = -rng.uniform(0.5, 1.0, 2), rng.uniform(0.5, 1.0, 2)
        limits = {name: (low[i], high[i]) for i, name in enumerate("uv")}
        ends = _pushed(np.eye(2), at, radius, limits).ends
        for i in range(2):
            exact_low = _exact(low[i]) - _exact(at[1 + i]) - _exact(radius)
            exact_high = _exact(high[i]) - _exact(at[1 + i]) + _exact(radius)
            assert exact_low - Fraction(1, 10**12) <= _exact(ends[i, 0]) <= exact_low
            assert exact_high <= _exact(ends[i, 1]) <= exact_high + Fraction(1, 10**12)
    for side in (-1.0, 1.0):
        for share, is_within in ((0.99, True), (1.01, False)):
            at = np.array([0.0, 0.0, side * share * (0.5 - radius)])
            beyond = _pushed(np.eye(2), at, radius, {"u": (-1.0, 1.0), "v": (-0.5, 0.5)})
            if is_within:
                assert np.all(np.isfinite(beyond.ends))
            else:
                with pytest.raises(Rejected, match="v is not proved"):
                    _ = beyond.ends


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_boxes_that_touch_a_limit_are_not_outside(radius: float, side: float) -> None:
    """A box is beyond a state limit only if all of its points are, for every equilibrium in it.

    The nearest corner of each box is exactly at the limit, or 1e-9 beyond it.
    """
    places = _places(radius, 15)
    inverse = [[Fraction(x) for x in row] for row in (M * 1.0).tolist()]
    (p, q), (r, s) = inverse
    determinant = p * s - q * r
    N = [[s / determinant, -q / determinant], [-r / determinant, p / determinant]]
    at = np.array([0.1, -0.2, 0.0, 0.0])
    plant = _inequality(0.0).plant
    for centre, half in zip(
        places.boxes.centres[:100].tolist(), places.boxes.half_widths[:100].tolist(), strict=True
    ):
        box = Boxes(np.array([centre]), -np.log2(np.array([half])).astype(int))
        middle = sum(N[0][k] * Fraction(centre[k]) for k in range(2))
        reach = sum(abs(N[0][k]) * Fraction(half[k]) for k in range(2)) + _exact(radius)
        nearest = _exact(at[0]) + middle - Fraction(side) * reach  # the point nearest to the limit
        for beyond in (0.0, 1e-9):
            end = float(nearest) - side * beyond
            limits = {**ENDS, "a": (-9.0, end) if side > 0.0 else (end, 9.0)}
            if beyond == 0.0 and side * (_exact(end) - nearest) < 0:
                limits["a"] = tuple(np.nextafter(limits["a"], side * np.inf).tolist())
            equilibrium = Equilibrium(at, np.full(4, radius))
            inequality = CostInequality(replace(plant, limits=limits), equilibrium, PIECE, Q, R)
            assert inequality.is_outside(box).tolist() == [beyond > 0.0]


def test_the_error_of_the_inverse_is_included() -> None:
    """A box 0.004 beyond a limit is not outside if entries of M⁻¹ = I are known within 0.01.

    Its models of z then contain all deviations. The error is planted, as the true one is 1e-15.
    """
    inequality = replace(_inequality(0.0), piece=PIECE._replace(M=np.eye(2)))
    box = Boxes(np.array([[0.5, 0.5]]), np.array([[2, 2]]))  # y_1 from 0.25 to 0.75
    beyond = replace(inequality.plant, limits={**ENDS, "a": (-1.0, 0.246)})
    inequality = replace(inequality, plant=beyond)
    assert inequality.is_outside(box).tolist() == [True]
    vars(inequality)["inverse"] = (np.eye(2), np.full((2, 2), 0.01))
    assert inequality.is_outside(box).tolist() == [False]
    _, radius = inequality.symbols_on(box)
    assert np.all(radius[2:4] >= 0.01 * 1.5)


@pytest.mark.parametrize(
    ("off", "radius", "is_near"),
    [(0.0, 0.0, True), (0.9e-6, 0.0, True), (0.9e-6, 0.2e-6, False), (-1.1e-6, 0.0, False)],
)
def test_an_equilibrium_is_near_with_all_of_its_enclosure(
    off: float, radius: float, is_near: bool
) -> None:
    """The enclosure of an equilibrium is within 1e-6 nominal values, here 2, of the stated one."""
    states = {"a": Signal(), "b": Signal(nominal=2.0)}
    plant = replace(_inequality(0.0).plant, model=replace(MODEL, states=states))
    at = Equilibrium(np.array([0.5, 0.5 + 2.0 * off]), np.array([0.0, 2.0 * radius]))
    with nullcontext() if is_near else pytest.raises(Rejected, match="b at the equilibrium"):
        check_near(at, plant, {"a": 0.5, "b": 0.5}, "the stated one")
