"""Enclosed functions of the checker of regions, compared with formulas.

The formulas are evaluated in doubles at random points.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from proofs import decided

from hfa_aircraft.model import Model, Signal
from hfa_prove.check.cover import Boxes, RefutedError
from hfa_prove.check.equilibrium import Equilibrium, check_near
from hfa_prove.check.region_boxes import Decrease
from hfa_prove.enclosure.taylor import lowest
from hfa_prove.fields import Rejected
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial

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
K = np.array([[0.5, 0.25], [-0.25, 0.5]])


class Places(NamedTuple):
    """Random points in boxes.

    boxes: the boxes
    s: (N, 2), position in the box, from -1 to 1
    y, z: (N, 2), coordinates and deviations at these points
    e: (N, 2), errors of the equilibrium
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
    e = radius * np.sign(rng.normal(size=(count, 2)))
    return Places(Boxes(centres, depths), s, y, y @ np.linalg.inv(M).T, e)


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


def _decrease(radius: float) -> Decrease:
    gain = Gain(K, {"u": ((0.25, (2, 0)),)})
    limits = {**ENDS, "load": (-2.0, 3.0)}
    loop = Loop(MODEL, {}, AT, INPUTS, {}, limits, gain)
    extents = np.array([[-0.7, 0.9], [-0.8, 0.6]])
    multipliers = np.array([[0.5, 0.25], [0.75, 1.0]])
    return Decrease(loop, Equilibrium(np.zeros(2), np.full(2, radius)), PIECE, extents, multipliers)


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_functions_of_a_region_are_above_their_bounds(radius: float) -> None:
    """Each function of a region is at least its lower bound on the boxes.

    The functions are -V', the distances of an output from its limits, and the distances of the
    states from their extents.
    """
    places = _places(radius, 11)
    decrease = _decrease(radius)
    bounds = lowest(decrease._functions.of(*decrease.symbols_on(places.boxes)), 2)
    x = places.z + places.e
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
    assert replace(_decrease(0.0), piece=piece).is_outside(small).tolist() == [share > 0.0]


def _small_box(y: tuple[float, float]) -> Boxes:
    return Boxes(np.array([y]), np.array([[20, 20]]))


def test_a_violated_inequality_is_refuted_at_a_point_of_the_set() -> None:
    """A point of the set where an inequality is violated is returned, and none outside the set."""
    inside, outside = (0.25, 0.125), (0.75, 0.5)
    question = replace(_decrease(0.0), extents=np.array([[-0.01, 0.01], [-0.01, 0.01]]))
    with pytest.raises(RefutedError) as refuted:
        question.edges(_small_box(inside))
    assert refuted.value.place.tolist() == list(inside)
    question.edges(_small_box(outside))


def test_the_error_of_the_inverse_is_included() -> None:
    """The models of z contain all deviations if entries of M⁻¹ = I are known within 0.01.

    The error is planted, as the true one is 1e-15.
    """
    question = replace(_decrease(0.0), piece=PIECE._replace(M=np.eye(2)))
    vars(question)["inverse"] = (np.eye(2), np.full((2, 2), 0.01))
    _, radius = question.symbols_on(Boxes(np.array([[0.5, 0.5]]), np.array([[2, 2]])))
    assert np.all(radius[2:4] >= 0.01 * 1.5)


def test_the_edge_with_the_largest_effect_is_halved() -> None:
    """The edge is halved on which the undecided function varies most, or W at a face of the cube.

    W = 0.75 y_1² + 0.0625 y_2² varies most with y_1, and the load y_1 + a y_2 with y_2 for a = 4.
    """
    chosen = []
    for a in (0.25, 4.0):
        model = replace(
            MODEL,
            equations=lambda x, u, p, w, a=a: (_equations(x, u, p, w)[0], {"load": x.a + a * x.b}),
        )
        W = Polynomial(2, ((0.75, (2, 0)), (0.0625, (0, 2))))
        question = _decrease(0.0)
        loop = replace(question.loop, model=model)
        question = replace(question, loop=loop, piece=Piece(np.eye(2), W, 0.5))
        boxes = Boxes(np.array([[0.375, 0.375], [0.5, 0.5]]), np.array([[3, 3], [1, 1]]))
        traced = question._functions.traced(*question.symbols_on(boxes))
        load = np.ones(2, dtype=int)
        sharpened = question._functions.sharpened(traced, load, np.arange(2))
        chosen.append(question.decisive_edges(boxes, sharpened.lowered_by).tolist())
    assert chosen == [[0, 0], [1, 0]]


@pytest.mark.parametrize(
    ("off", "radius", "is_near"),
    [(0.0, 0.0, True), (0.9e-6, 0.0, True), (0.9e-6, 0.2e-6, False), (-1.1e-6, 0.0, False)],
)
def test_an_equilibrium_is_near_with_all_of_its_enclosure(
    off: float, radius: float, is_near: bool
) -> None:
    """The enclosure of an equilibrium is within 1e-6 nominal values, here 2, of the stated one."""
    states = {"a": Signal(), "b": Signal(nominal=2.0)}
    loop = replace(_decrease(0.0).loop, model=replace(MODEL, states=states))
    at = Equilibrium(np.array([0.5, 0.5 + 2.0 * off]), np.array([0.0, 2.0 * radius]))
    with decided(is_near, "b at the equilibrium", Rejected):
        check_near(at, loop, {"a": 0.5, "b": 0.5})
