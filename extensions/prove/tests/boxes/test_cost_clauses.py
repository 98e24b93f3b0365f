"""Lower bounds of the cost: proved, slightly too high, and forged."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import (
    SCHEMA,
    Certificate,
    read_certificate,
    read_content,
    read_statement,
    write_certificate,
)
from hfa_prove.check import check
from hfa_prove.check.cost import (
    CostInequality,
    Guess,
    check_cost,
)
from hfa_prove.check.cover import Boxes, OpenBoxError, RefutedError
from hfa_prove.check.equilibrium import Equilibrium, equilibrium_near
from hfa_prove.search.clock import Clock
from hfa_prove.search.cost import CostBound, CostSearch
from hfa_prove.statements.cost import CostStatement, CostWitness
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant, Subject
from hfa_support.errors import BadInputError, NoSolutionError

ONE = np.eye(1)


def cart(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"position": u.speed}, {}


def pendulum(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"angle": x.rate, "rate": 10.0 * ca.sin(x.angle) + 20.0 * u.torque + u.torque**3}, {}


CART = Model("cart", {"position": Signal("m")}, {"speed": Signal("m/s")}, cart, trim={})
PENDULUM = Model(
    "cubic pendulum",
    {"angle": Signal("rad"), "rate": Signal("rad/s")},
    {"torque": Signal("N m", 1.0, -0.7, 0.7)},
    pendulum,
    trim={"angle": 0.0, "rate": 0.0},
)


def cart_bound(coefficient: float) -> CostStatement:
    """Return the claim W = coefficient y² for x' = u with Q = R = 1, where the least cost is y²."""
    plant = Plant(CART, {}, {"position": 0.0}, {"speed": 0.0}, {}, {})
    piece = Piece(ONE, Polynomial(1, ((coefficient, (2,)),)), 0.5)
    return CostStatement(plant, {"position": 0.0, "speed": 0.0}, ONE, ONE, (piece,))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('"c": 0.5', '"c": 0.75'),
        ('"boxes": [9]', '"boxes": [10]'),
        ('"date": "today"', '"date": "monday"'),
        ('"digest": "', '"digest": "0'),
        ('"kind": "cost"', '"kind": "region", "kind": "cost"'),
        ('"c": 0.5', '"c": 0.75, "c": 0.5'),
        ('"c": 0.5', '"c": 0.50'),
    ],
)
def test_a_certificate_that_was_edited_is_refused(before: str, after: str, tmp_path: Path) -> None:
    """An edit of any text of a file is refused: a value, a seal, a second entry, another digit."""
    path = tmp_path / "cost.json"
    origin = {"version": "1", "command": "hfa prove cost", "date": "today"}
    witness = CostWitness(("position",), (9,)).content()
    write_certificate(path, cart_bound(0.7), witness, origin)
    assert read_certificate(path, Subject(CART)).written == origin
    text = path.read_text()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))
    with pytest.raises(BadInputError, match="edited"):
        read_certificate(path, Subject(CART))


@pytest.mark.parametrize("method", ["linear", "bspline"])
def test_derivatives_of_smooth_tables_are_refused(method: str) -> None:
    """Rates with a linear table have a bound. For a smooth table, linear tables are recommended."""
    table = ca.interpolant("drag", method, [[-9.0, -3.0, 3.0, 9.0]], [0.9, 0.3, -0.3, -0.9])

    def rates(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"position": u.speed + table(x.position)}, {}

    model = replace(CART, name="brake", equations=rates)
    plant = Plant(model, {}, {"position": 0.0}, {"speed": 0.0}, {}, {})
    claim = replace(cart_bound(0.7), plant=plant)
    witness = CostWitness(("position",), (1000,))
    if method == "linear":
        assert check_cost(claim, witness)[0] > 0
    else:
        with pytest.raises(BadInputError, match="the method 'linear'"):
            check_cost(claim, witness)


def test_a_bound_is_at_most_its_level() -> None:
    """The bound is W = 0.9 y² up to the level 0.5, the level above it, and outside of |y| < 1.

    The argument is the deviation from the trim, y that from the equilibrium.
    """
    moved = replace(cart_bound(0.9), equilibrium={"position": 0.25, "speed": 0.0})
    found = moved.bound(np.array([[0.35], [1.15], [-0.65], [3.25]]))
    assert found == pytest.approx([0.009, 0.5, 0.5, 0.5])


@pytest.mark.parametrize("margin", [1e-13, 0.1])
def test_a_margin_of_1e13_is_decided_correctly(margin: float) -> None:
    """The bound (1 - margin) y² is proved, and (1 + margin) y² is refused. The least cost is y².

    The margins are 1e-13 and 0.1. The cart is in equilibrium at every position. The unknown of its
    equilibrium equations is therefore the input.
    """
    witness = CostWitness(("speed",), (1000,))
    assert check_cost(cart_bound(1.0 - margin), witness)[0] > 0
    with pytest.raises(NoSolutionError, match="not proved near the equilibrium"):
        check_cost(cart_bound(1.0 + margin), witness)


@pytest.mark.parametrize(("k", "is_proved"), [(0.5 - 1e-12, True), (0.5 + 1e-9, False)])
def test_a_cost_without_inputs_is_decided(k: float, is_proved: bool) -> None:
    """The cost of x' = -x from z is z²/2, with one state and no inputs."""
    model = Model("decay", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": -x.x}, {}), trim={})
    plant = Plant(model, {}, {"x": 0.0}, {}, {}, {})
    piece = Piece(ONE, Polynomial(1, ((k, (2,)),)), 0.05)
    claim = CostStatement(plant, {"x": 0.0}, ONE, np.zeros((0, 0)), (piece,))
    if is_proved:
        assert check_cost(claim, CostWitness(("x",), (1000,)))[0] > 0
    else:
        with pytest.raises(NoSolutionError, match="not proved near the equilibrium"):
            check_cost(claim, CostWitness(("x",), (1000,)))


#: Terms of W above the least cost a² + b²/2 of a' = u, b' = -b with unit weights.
TOO_LARGE = [
    [(1.0 + 1e-12, (2, 0)), (0.5, (0, 2))],
    [(0.9, (2, 0)), (0.5 + 1e-9, (0, 2))],
    [(1.0, (2, 0)), (0.4, (0, 2)), (1e-6, (4, 0))],
    [(1.0, (2, 0)), (0.4, (0, 2)), (0.015625, (3, 0))],
    [(1.0, (2, 0)), (0.5, (0, 2)), (1e-6, (1, 1))],
    [(1.0 - 2.0**-6, (2, 0)), (0.4, (0, 2)), (1.0, (8, 0))],
]


@pytest.mark.parametrize("terms", TOO_LARGE)
def test_a_w_above_the_least_cost_is_refused(terms: list[Any]) -> None:
    """W is refused that is too large by a hair, on one side, far out, or in a free state alone."""
    two = Model(
        "two",
        {"a": Signal("m"), "b": Signal("m")},
        {"speed": Signal("m/s")},
        lambda x, u, p, w: ({"a": u.speed, "b": -x.b}, {}),
    )
    plant = Plant(two, {}, {"a": 0.0, "b": 0.0}, {"speed": 0.0}, {}, {})
    at = {"a": 0.0, "b": 0.0, "speed": 0.0}
    weights = (np.eye(2), ONE)
    for listed, is_proved in (([(0.99, (2, 0)), (0.49, (0, 2))], True), (terms, False)):
        piece = Piece(np.eye(2), Polynomial(2, tuple(listed)), 0.45)
        claim = CostStatement(plant, at, *weights, (piece,))
        if is_proved:
            assert check_cost(claim, CostWitness(("speed", "b"), (4000,)))[0] > 0
            continue
        with pytest.raises(NoSolutionError, match=r"near the equilibrium|at a point of the set"):
            check_cost(claim, CostWitness(("speed", "b"), (4000,)))


def test_an_input_that_bends_the_rates_needs_limits() -> None:
    """A bound is refused if an input without limits enters the rates as a cubic polynomial."""
    model = replace(PENDULUM, inputs={"torque": Signal("N m")})
    plant = Plant(model, {}, {"angle": 0.0, "rate": 0.0}, {"torque": 0.0}, {}, {})
    piece = Piece(np.eye(2), Polynomial(2, ((0.01, (2, 0)), (0.01, (0, 2)))), 0.001)
    claim = CostStatement(plant, {**plant.trim, **plant.inputs}, np.eye(2), ONE, (piece,))
    with pytest.raises(BadInputError, match="not affine in torque, which has no limits"):
        check_cost(claim, CostWitness(("angle", "rate"), (1000,)))


THRUST = ca.interpolant("thrust", "linear", [[-1.0, -0.5, 1.0]], [-3.5, -0.5, 1.0])
#: Rates above u for u < -0.5, where W = 0.9 y² exceeds the cost at which y = 0.4 is left.
KINKED: dict[str, Any] = {
    "kink": lambda u: u + 5.0 * ca.fmin(u + 0.5, 0.0),
    "jump": lambda u: u - ca.if_else(u < -0.5, 5.0, 0.0),
    "table": THRUST,
    "kink of a square": lambda u: u - 5.0 * ca.fmax(u**2 - 0.25, 0.0),
}


@pytest.mark.parametrize("name", KINKED)
def test_rates_with_a_kink_in_an_input_are_refused(name: str) -> None:
    """Second derivatives of x' = u + 5 min(u + 0.5, 0) in u are 0, and W = 0.9 x² no lower bound."""
    for of_input, is_proved in ((lambda u: u, True), (KINKED[name], False)):

        def rates(x: Any, u: Any, p: Any, w: Any, of_input: Any = of_input) -> Any:
            return {"position": of_input(u.speed)}, {}

        model = replace(SLED, equations=rates)
        limits = {"speed": (-1.0, 1.0)}
        plant = Plant(model, {}, {"position": 0.0}, {"speed": 0.0}, {}, limits)
        claim = replace(cart_bound(0.9), plant=plant)
        claim = replace(claim, pieces=(claim.pieces[0]._replace(c=0.2),))
        if is_proved:
            assert check_cost(claim, CostWitness(("speed",), (1000,)))[0] > 0
            continue
        with pytest.raises(BadInputError, match="a kink or a table of speed"):
            check_cost(claim, CostWitness(("speed",), (1000,)))


@pytest.mark.parametrize("solved", [("angle", "angle"), ("angle", "rate", "torque")])
def test_an_equilibrium_has_as_many_unknowns_as_states(
    solved: tuple[str, ...], proved: CostBound
) -> None:
    """A witness that names fewer unknowns (one of them twice) or more than states is refused."""
    with pytest.raises(NoSolutionError, match="numbers of unknowns"):
        check_cost(proved.statement, replace(proved.witness, solved=solved))


@pytest.fixture(scope="module")
def proved() -> CostBound:
    """Return the proved bound of a pendulum whose torque acts through a cubic polynomial."""
    limits = {"torque": (-0.7, 0.7), "rate": (-2.0, 2.0)}
    plant = Plant(PENDULUM, {}, {"angle": 0.0, "rate": 0.0}, {"torque": 0.0}, {}, limits)
    A = np.array([[0.0, 1.0], [10.0, 0.0]])
    B = np.array([[0.0], [20.0]])
    P = scipy.linalg.solve_continuous_are(A, B, np.eye(2), ONE)
    return search_of(plant, P, np.array([0.4, 0.8]), 4, 30.0).found()


def search_of(
    plant: Plant, P: np.ndarray, half: np.ndarray, degree: int, seconds: float
) -> CostSearch:
    """Return a search with unit weights and a margin of 0.05.

    P: matrix of the linear quadratic cost
    half: half-widths of the box of initial conditions
    degree: degree of W
    """
    n = len(P)
    equilibrium = equilibrium_near(plant, np.zeros(n + 1), tuple(range(n)))
    weights = (np.eye(n), ONE, P)
    return CostSearch(
        plant,
        equilibrium,
        tuple(range(n)),
        weights,
        half,
        degree=degree,
        margin=0.05,
        clock=Clock(seconds),
    )


def test_the_checker_repeats_the_proof(proved: CostBound) -> None:
    """The checker verifies the bound, and evaluates as many boxes of each piece as the prover."""
    found = check(Certificate(Path("cost.json"), proved.statement, proved.witness, {}))
    assert found.sizes == proved.boxes
    assert found.size == sum(proved.boxes)


def test_no_flight_costs_less_than_the_bound(proved: CostBound) -> None:
    """No simulated flight that returns to the trim costs less than the proved bound.

    1 % is allowed for the integration. The flights have random gains. The median of bound / cost
    exceeds 0.8.
    """
    rng = np.random.default_rng(0)
    z = np.array([0.4, 0.8]) * rng.uniform(-1.0, 1.0, (400, 2))
    begin = proved.statement.bound(z)
    gain = np.array([1.6, 0.6]) * rng.uniform(0.7, 1.3, (400, 2))
    paid = np.zeros(400)
    step = 0.002
    for _ in range(4000):
        torque = np.clip(-np.sum(gain * z, axis=1), -0.7, 0.7)
        paid += step * (np.sum(z * z, axis=1) + torque**2)
        middle = z + 0.5 * step * _rates(z, torque)
        z = z + step * _rates(middle, torque)
    back = np.linalg.norm(z, axis=1) < 1e-3
    assert back.sum() > 200
    assert np.all(begin[back] <= 1.01 * paid[back])
    assert np.median(begin[back] / paid[back]) > 0.8


def _rates(z: np.ndarray, torque: np.ndarray) -> np.ndarray:
    rate = 10.0 * np.sin(z[:, 0]) + 20.0 * torque + torque**3
    return np.column_stack([z[:, 1], rate])


def content_of(bound: CostBound) -> dict[str, Any]:
    content = {
        **{"schema": SCHEMA, "toolchain": "", "digest": "", "provenance": {}, "checksum": ""},
        "kind": "cost",
        "statement": bound.statement.content(),
        "witness": {
            "solved": ["angle", "rate"],
            "boxes": list(bound.witness.boxes),
        },
    }
    return json.loads(json.dumps(content))


def scaled(rows: Any, factor: float) -> Any:
    return (np.array(rows) * factor).tolist()


def larger(s: Any, w: Any) -> None:
    last = s["pieces"][-1]
    last["W"] = [[value * 1.0625, powers] for value, powers in last["W"]]


#: Forgery -> change of statement and witness, and words of the clause that refuses it.
FORGED: dict[str, tuple[Callable[[Any, Any], None], str]] = {
    "W larger": (larger, "does not hold at a point"),
    "level": (
        lambda s, w: s["pieces"][-1].update(c=4.0 * s["pieces"][-1]["c"]),
        "extends beyond the boxes",
    ),
    "cube smaller": (
        lambda s, w: s["pieces"][0].update(M=scaled(s["pieces"][0]["M"], 1.5)),
        "not proved near the equilibrium",
    ),
    "M singular": (
        lambda s, w: s["pieces"][0].update(M=[[1.0, 1.0], [1.0, 1.0]]),
        "y = M z is singular",
    ),
    "Q smaller": (lambda s, w: s.update(Q=scaled(s["Q"], 0.8)), "not proved near the equilibrium"),
    "R smaller": (lambda s, w: s.update(R=[[0.8]]), "not proved near the equilibrium"),
    "input wider": (
        lambda s, w: s["plant"]["limits"].update(torque=[-7.0, 7.0]),
        "torque not the model's",
    ),
    "envelope without the trim": (
        lambda s, w: s["plant"]["limits"].update(rate=[0.5, 2.0]),
        "outside the state limits",
    ),
    "trim": (lambda s, w: s["plant"]["trim"].update(angle=0.01), "differs from the trim"),
    "input": (lambda s, w: s["plant"]["inputs"].update(torque=0.01), "torque .*from the trim"),
    "equilibrium": (lambda s, w: s["equilibrium"].update(angle=0.01), "differs from the stated"),
    "model": (lambda s, w: s["plant"]["model"].update(dynamics="van der Pol"), "other equations"),
    "equations": (lambda s, w: s["plant"]["model"].update(equations="0" * 64), "other equations"),
    "boxes": (lambda s, w: w.update(boxes=[3] * len(w["boxes"])), "undecided after 3 boxes"),
    "boxes missing": (lambda s, w: w.update(boxes=w["boxes"][1:]), "witness: boxes"),
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_bound_is_refused(name: str, proved: CostBound) -> None:
    """Each forgery of a bound is refused by its clause."""
    content = content_of(proved)
    for each in (content["statement"]["pieces"], content["witness"]["boxes"]):
        del each[1:-1]  # the proofs of the others are similar
    read_content(copy.deepcopy(content), Subject(PENDULUM))
    change, message = FORGED[name]
    change(content["statement"], content["witness"])
    with pytest.raises((NoSolutionError, BadInputError), match=message):
        check_cost(*read_content(content, Subject(PENDULUM)))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("Q",), [[-1.0]]),
        (("R",), [[-1.0]]),
        (("plant", "limits"), {"speed": [None, 0.5]}),
        (("plant", "limits"), {"speed": [-0.5, None]}),
        *((("Q",), value) for value in ([[1.0, 0.0]], [[None]], [[True]], 1.0)),
        *((("pieces",), value) for value in ([], None, {})),
        *((("equilibrium",), value) for value in ({"position": 0.0}, {"speed": 0.0})),
        *((("solved",), value) for value in (["mass"], ["speed", "speed"], "speed", [1])),
        *((("boxes",), value) for value in ([], [9, 9], [10**9 + 1], [True], [None], 9)),
        (("claim",), 1.0),
    ],
)
def test_entries_that_no_bound_admits_are_refused(path: tuple[str, ...], value: Any) -> None:
    """Indefinite weights, limits of an input that are not the model's, and entries of another
    type, number or name are refused.
    """
    closing = dict.fromkeys(("toolchain", "digest", "provenance", "checksum"), "")
    statement, witness = cart_bound(0.5).content(), {"solved": ["speed"], "boxes": [9]}
    content = {**closing, "schema": SCHEMA, "kind": "cost"}
    content |= {"statement": statement, "witness": witness}
    assert read_content(copy.deepcopy(content), Subject(CART))[1].boxes == (9,)
    entry: Any = witness if path[0] in ("solved", "boxes", "claim") else statement
    for name in path[:-1]:
        entry = entry[name]
    entry[path[-1]] = value
    with pytest.raises(NoSolutionError, match=f"invalid entry: .*{path[-1]}"):
        read_content(content, Subject(CART))


def test_a_weight_that_is_not_symmetric_is_refused(proved: CostBound) -> None:
    """A Q of which only the lower triangle belongs to a semidefinite matrix is refused."""
    content = proved.statement.content()
    read_statement("cost", copy.deepcopy(content), Subject(PENDULUM))
    content["Q"][0][1] += 9.0
    with pytest.raises(NoSolutionError, match="Q: not symmetric"):
        read_statement("cost", content, Subject(PENDULUM))


def test_a_limit_of_an_output_is_refused() -> None:
    """A limit of an output is refused, because the envelope consists of state limits only."""
    outputs = {"load": Signal("m", 1.0, -1.0, 1.0)}

    def loaded(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"position": u.speed}, {"load": x.position}

    model = replace(CART, equations=loaded, outputs=outputs)
    bound = cart_bound(0.5)
    content = replace(bound, plant=replace(bound.plant, model=model)).content()
    read_statement("cost", copy.deepcopy(content), Subject(model))
    with pytest.raises(NoSolutionError, match="load is an output"):
        read_statement(
            "cost",
            content | {"plant": content["plant"] | {"limits": {"load": [-1.0, 1.0]}}},
            Subject(model),
        )


def wagon(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"position": u.pull + u.push + 0.9 * u.pull * u.push}, {}


WAGON = Model(
    "wagon",
    {"position": Signal("m")},
    {"pull": Signal("N", 1.0, -1.0, 1.0), "push": Signal("N", 1.0, -1.0, 1.0)},
    wagon,
    trim={},
)


def test_the_loss_bounds_the_excess_of_guessed_inputs() -> None:
    """At five guesses of the best inputs, `_loss` bounds the excess of g over its minimum.

    g = 2 k y (a + b + 0.9 a b) + y² + a² + b² is the cost inequality for the inputs a and b.
    """
    limits = {"pull": (-1.0, 1.0), "push": (-1.0, 1.0)}
    plant = Plant(WAGON, {}, {"position": 0.0}, {"pull": 0.0, "push": 0.0}, {}, limits)
    k = 0.75
    inequality = CostInequality(
        plant,
        Equilibrium(np.zeros(3), np.zeros(3)),
        Piece(ONE, Polynomial(1, ((k, (2,)),)), 1.0),
        ONE,
        np.eye(2),
    )
    y = 0.5

    def g(a: Any, b: Any) -> Any:
        return 2.0 * k * y * (a + b + 0.9 * a * b) + y**2 + a**2 + b**2

    axis = np.linspace(-1.0, 1.0, 201)
    least = g(axis[:, None], axis).min()
    box = Boxes(np.array([[y]]), np.array([[40]]))
    for guess in ([-0.78, 0.22], [0.4, -0.5], [0.6, 0.6], [-0.9, -0.9], [-0.28, -0.28]):
        about = Guess(np.array([guess]), np.zeros((1, 2, 1)))
        assert g(*guess) - inequality._loss(box, about)[0] <= least + 1e-6


def sled(x: Any, u: Any, p: Any, w: Any) -> Any:
    return {"position": u.speed + u.speed**3}, {}


SLED = Model(
    "sled",
    {"position": Signal("m")},
    {"speed": Signal("m/s", 1.0, -10.0, 10.0)},
    sled,
    trim={"position": 0.0},
)


@pytest.mark.parametrize("ends", [(-10.0, 0.1), (-0.1, 10.0)])
def test_the_best_input_may_be_far_from_equilibrium(ends: tuple[float, float]) -> None:
    """A bound is proved in a small set, and refused where g >= 0 fails far from the equilibrium input.

    g = y (u + u³) + y² + u² is convex in u up to 10 for |y| < 1 / 30. It is negative for u = -10
    and y = 0.11, and for u = 10 and y = -0.11.
    """
    low, high = ends
    ends_declared = {"speed": Signal("m/s", 1.0, low, high)}
    plant = Plant(
        replace(SLED, inputs=ends_declared),
        {},
        {"position": 0.0},
        {"speed": 0.0},
        {},
        {"speed": ends},
    )
    witness = CostWitness(("speed",), (1000,))
    small, large = (
        CostStatement(
            plant,
            {"position": 0.0, "speed": 0.0},
            ONE,
            ONE,
            (Piece(ONE, Polynomial(1, ((0.5, (2,)),)), 0.5 * y**2),),
        )
        for y in (0.03, 0.11)
    )
    assert check_cost(small, witness)[0] > 0
    with pytest.raises(OpenBoxError, match="undecided"):
        check_cost(large, witness)


@pytest.mark.parametrize("limits", [(-1.0, -0.1), (0.1, 1.0)])
def test_an_equilibrium_outside_a_limit_is_refused(limits: tuple[float, float]) -> None:
    """An equilibrium outside the state limits is refused."""
    still = {"position": 0.0, "speed": 0.0}
    plant = Plant(CART, {}, {"position": 0.0}, {"speed": 0.0}, {}, {"position": limits})
    statement = CostStatement(plant, still, ONE, ONE, cart_bound(0.9).pieces)
    with pytest.raises(NoSolutionError, match="outside the state limits"):
        check_cost(statement, CostWitness(("speed",), (1000,)))


def test_boxes_that_cross_a_limit_are_checked() -> None:
    """A bound is refused if it fails only in boxes that a state limit crosses.

    The slope of W, 1.8 y + 80 y³, exceeds the slope 2 y of the least cost only between 0.05 and the
    limit 0.1.
    """
    plant = Plant(CART, {}, {"position": 0.0}, {"speed": 0.0}, {}, {"position": (-0.1, 0.1)})
    piece = Piece(ONE, Polynomial(1, ((0.9, (2,)), (20.0, (4,)))), 0.02)
    statement = CostStatement(plant, {"position": 0.0, "speed": 0.0}, ONE, ONE, (piece,))
    with pytest.raises(RefutedError):
        check_cost(statement, CostWitness(("speed",), (1000,)))


def test_the_inequality_is_checked_on_both_sides() -> None:
    """A bound is refused if its inequality g >= 0 fails on one side of the equilibrium only.

    g = y (u + 2 y²) + y² + u² is convex for y > 0 and negative at y = -0.4, u = 0.2.
    """
    hill = replace(
        SLED, equations=lambda x, u, p, w: ({"position": u.speed + 2 * x.position**2}, {})
    )
    plant = Plant(hill, {}, {"position": 0.0}, {"speed": 0.0}, {}, {"speed": (-10.0, 10.0)})
    piece = Piece(ONE, Polynomial(1, ((0.5, (2,)),)), 0.1)
    statement = CostStatement(plant, {"position": 0.0, "speed": 0.0}, ONE, ONE, (piece,))
    with pytest.raises(RefutedError):
        check_cost(statement, CostWitness(("speed",), (1000,)))


def test_a_bound_with_gradient_at_trim_is_refused() -> None:
    """A bound W with a nonzero gradient at the trim is refused."""
    content = cart_bound(0.5).content()
    read_statement("cost", copy.deepcopy(content), Subject(CART))
    content["pieces"][0]["W"].append([0.01, [1]])
    with pytest.raises(NoSolutionError, match="W 1"):
        read_statement("cost", content, Subject(CART))


def test_the_loss_covers_varying_guesses() -> None:
    """`_loss` bounds the suboptimality of an input guess that varies from -0.3 to -0.1 over a box.

    At the center of the box, the cost of the input -0.1 is compared with the cost of the optimal
    input, which is the limit -0.3.
    """
    k = 0.75
    two = Model(
        "two",
        {"a": Signal(), "b": Signal()},
        {"speed": Signal()},
        lambda x, u, p, w: ({"a": u.speed, "b": -x.b}, {}),
    )
    plant = Plant(two, {}, {"a": 0.0, "b": 0.0}, {"speed": 0.0}, {}, {"speed": (-0.3, 0.3)})
    piece = Piece(np.eye(2), Polynomial(2, ((k, (2, 0)), (k, (0, 2)))), 1.0)
    equilibrium = Equilibrium(np.zeros(3), np.zeros(3))
    inequality = CostInequality(plant, equilibrium, piece, np.eye(2), ONE)
    y = 0.5
    box = Boxes(np.array([[y, 0.0]]), np.full((1, 2), 40))
    loss = inequality._loss(box, Guess(np.array([[-0.2]]), np.array([[[0.04, -0.06]]])))[0]

    def g(u: float) -> float:
        return 2.0 * k * y * u + y**2 + u**2

    assert g(-0.1) - loss <= g(-0.3) + 1e-9


def test_bounds_of_inputs_contain_one_of_zero_slope() -> None:
    """The bounds of the best inputs contain an input in which the inequality g has no slope at 0.

    For x' = pull + 0.9 pull push, the best push is 0.14.
    """
    twisted = replace(
        WAGON, equations=lambda x, u, p, w: ({"position": u.pull + 0.9 * u.pull * u.push}, {})
    )
    limits = {"pull": (-1.0, 1.0), "push": (-1.0, 1.0)}
    plant = Plant(twisted, {}, {"position": 0.0}, {"pull": 0.0, "push": 0.0}, {}, limits)
    equilibrium = Equilibrium(np.zeros(3), np.zeros(3))
    W = Polynomial(1, ((0.75, (2,)),))
    inequality = CostInequality(plant, equilibrium, Piece(ONE, W, 1.0), ONE, np.eye(2))
    radii = inequality._best_inputs_within(Boxes(np.zeros((1, 1)), np.ones((1, 1), dtype=int)))
    y = 0.5
    best = -np.linalg.solve([[2.0, 1.35 * y], [1.35 * y, 2.0]], [1.5 * y, 0.0])
    assert radii is not None
    assert np.all(np.abs(best) <= radii)
    # inputs of different effect and curvature, which act against each other
    uneven = replace(WAGON, equations=lambda x, u, p, w: ({"position": u.pull + 0.5 * u.push}, {}))
    R = np.array([[5.5, -5.0], [-5.0, 5.125]])
    coupled = replace(inequality, plant=replace(plant, model=uneven), R=R)
    radii = coupled._best_inputs_within(Boxes(np.zeros((1, 1)), np.ones((1, 1), dtype=int)))
    assert radii is not None
    assert np.all(np.abs(np.linalg.solve(2.0 * R, [1.5 * y, 0.75 * y])) <= radii)


def test_curvature_of_three_inputs_bounds_all_directions() -> None:
    """The sum of the curvature bounds is at most the second derivative in the direction (1, 1, 1).

    For x' = a + b + c + 0.4 (a b + b c + c a) and a negative slope of W, the second derivative is
    lowest in this direction.
    """
    names = ("a", "b", "c")

    def cubed(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"position": u.a + u.b + u.c + 0.4 * (u.a * u.b + u.b * u.c + u.c * u.a)}, {}

    ends = dict.fromkeys(names, (-1.0, 1.0))
    signals = {name: Signal("1", 1.0, -1.0, 1.0) for name in names}
    model = Model("three", {"position": Signal("m")}, signals, cubed, trim={"position": 0.0})
    plant = Plant(model, {}, {"position": 0.0}, dict.fromkeys(names, 0.0), {}, ends)
    piece = Piece(ONE, Polynomial(1, ((1.0, (2,)),)), 1.0)
    equilibrium = Equilibrium(np.zeros(4), np.zeros(4))
    inequality = CostInequality(plant, equilibrium, piece, ONE, np.eye(3))
    box = Boxes(np.array([[-0.75]]), np.array([[2]]))
    limits = np.ones((1, 3))
    curvature = inequality._curvature(box, -limits, limits)[0]
    along = 6.0 - 2.0 * 0.4 * 6.0  # at y = -1
    assert curvature.sum() <= along + 1e-9


def _on_a_line(
    model: Model,
    k: float,
    radius: float = 0.0,
    ends: tuple[float, float] = (-1.0, 1.0),
    c: float = 1.0,
) -> CostInequality:
    """Return the cost inequality of W = k y² for a model with one state and one input.

    radius: error of the input at the equilibrium
    ends: limits of the input
    c: level of the set {W <= c}
    """
    plant = Plant(model, {}, {"position": 0.0}, {"speed": 0.0}, {}, {"speed": ends})
    equilibrium = Equilibrium(np.zeros(2), np.array([0.0, radius]))
    piece = Piece(ONE, Polynomial(1, ((k, (2,)),)), c)
    return CostInequality(plant, equilibrium, piece, ONE, ONE)


@pytest.mark.parametrize(("y", "high"), [(-0.125, 0.1), (0.125, 1.0)])
def test_the_loss_includes_the_curvature_at_the_limits_and_the_guess(y: float, high: float) -> None:
    """The loss of the guess 0.5 covers the best input in [-high, high], found on a grid.

    The second derivative 2 + 32 y u of g = 1.6 y (u + 10 u³ / 3) + y² + u² is lowest at the guess,
    beyond the limit 0.1, or at the limit -1.
    """
    steep = replace(
        SLED, equations=lambda x, u, p, w: ({"position": u.speed + 10.0 / 3.0 * u.speed**3}, {})
    )
    box = Boxes(np.array([[y]]), np.array([[40]]))
    guess = Guess(np.array([[0.5]]), np.zeros((1, 1, 1)))
    loss = _on_a_line(steep, 0.8, ends=(-high, high))._loss(box, guess)[0]
    u = np.append(np.linspace(-high, high, 2001), 0.5)
    g = 1.6 * y * (u + 10.0 / 3.0 * u**3) + y**2 + u**2
    assert loss >= g[-1] - g[:-1].min() > 0.05


def test_the_error_of_the_equilibrium_is_included() -> None:
    """The inequality g >= 0 is proved for an exact equilibrium, but not for one within 0.3.

    g = 1.5 y (u + e) + y² + u² is positive at y = 0.5 for e = 0, but not for all |e| <= 0.3.
    """
    assert _on_a_line(CART, 0.75, c=0.5).proved(10**4) > 0
    with pytest.raises(OpenBoxError, match="undecided"):
        _on_a_line(CART, 0.75, 0.3, c=0.5).proved(10**4)
    falling = replace(
        CART, equations=lambda x, u, p, w: ({"position": u.speed + x.position}, {})
    )  # g = 1.5 y (u + y + e) + y² + u²
    exact = _on_a_line(falling, 0.75, c=0.5)
    assert exact.proved(10**4) > 0
    known = Equilibrium(np.zeros(2), np.array([0.9, 0.0]))
    with pytest.raises(OpenBoxError, match="undecided"):
        replace(exact, equilibrium=known).proved(10**4)


def _of_two_states(W: Polynomial, c: float, Q: np.ndarray, R: np.ndarray) -> CostInequality:
    """Return the cost inequality on {W <= c} for y_1' = u, y_2' = -y_2, |u| <= 1."""
    model = Model(
        "two",
        {"position": Signal(), "other": Signal()},
        {"speed": Signal()},
        lambda x, u, p, w: ({"position": u.speed, "other": -x.other}, {}),
        trim={},
    )
    still = {"position": 0.0, "other": 0.0}
    plant = Plant(model, {}, still, {"speed": 0.0}, {}, {"speed": (-1.0, 1.0)})
    equilibrium = Equilibrium(np.zeros(3), np.zeros(3))
    return CostInequality(plant, equilibrium, Piece(np.eye(2), W, c), Q, R)


def test_a_set_may_not_leave_the_cube_beside_the_center_of_a_face() -> None:
    """A narrow valley of W that ends in the corner (1, 1) is refused, although g > 0 in it."""
    valley = ((0.1, (2, 0)), (-0.2 + 2.0**-14, (1, 1)), (0.1, (0, 2)))
    inequality = _of_two_states(Polynomial(2, valley), 1e-4, np.eye(2), ONE)
    with pytest.raises(RefutedError):
        inequality.proved(10**4)
    shorter = _of_two_states(Polynomial(2, valley), 5e-5, np.eye(2), ONE)
    assert shorter.proved(10**5) > 0


def test_the_loss_covers_guesses_of_both_signs() -> None:
    """`_loss` bounds the suboptimality of an input guess that varies from -0.2 to 0.2 over a box.

    The box has two states. The inequality is linear in the input with the slope 0.75, and the
    optimal input is the limit -1.
    """
    W = Polynomial(2, ((0.75, (2, 0)),))
    inequality = _of_two_states(W, 1.0, np.eye(2), np.zeros((1, 1)))
    box = Boxes(np.array([[0.5, 0.0]]), np.array([[40, 40]]))
    loss = inequality._loss(box, Guess(np.zeros((1, 1)), np.array([[[0.1, -0.1]]])))[0]
    assert loss >= 0.75 * 1.2 - 1e-9


def test_slopes_of_either_sign_bound_the_best_inputs() -> None:
    """The bounds of the best inputs are valid for slopes of W of both signs.

    For g = 2 k y u (1 - y) + y² + u² the best u is 0.75 k at y = -0.5 and -0.25 k at y = 0.5. For
    g = 0.01 y u + y² + 0.02 u² it is 0.125 at y = -0.5.
    """
    uneven = replace(
        SLED, equations=lambda x, u, p, w: ({"position": u.speed * (1.0 - x.position)}, {})
    )
    box = Boxes(np.zeros((1, 1)), np.ones((1, 1), dtype=int))
    (radius,) = _on_a_line(uneven, 0.5)._best_inputs_within(box)
    assert radius >= 0.375
    (radius,) = replace(_on_a_line(CART, 0.005), R=0.02 * ONE)._best_inputs_within(box)
    assert radius >= 0.125


def test_the_hessian_covers_all_inputs_within_radii() -> None:
    """The inequality is proved convex for inputs within 1e-3 of the guess, but not within 1.

    g = y (u + u³) + y² + u² is convex near u = 0 and not at u = 1.
    """
    inequality = _on_a_line(SLED, 0.5)
    box = Boxes(np.zeros((1, 1)), np.full((1, 1), 10))
    assert inequality._is_convex(box, np.array([1e-3]))
    assert not inequality._is_convex(box, np.array([1.0]))
    assert not _on_a_line(SLED, 0.5, radius=1.0)._is_convex(box, np.array([1e-3]))


def test_the_hessian_covers_both_ends_of_entries() -> None:
    """Convexity is refused if the Hessian is indefinite for one end of its enclosed entries.

    The mixed derivative of g = 0.6 y u (1 + 3 y) + y² + u² is 0.6 (1 + 6 y), from -1.2 to 2.4.
    """
    uneven = replace(
        SLED, equations=lambda x, u, p, w: ({"position": u.speed * (1.0 + 3.0 * x.position)}, {})
    )
    box = Boxes(np.zeros((1, 1)), np.ones((1, 1), dtype=int))
    assert not _on_a_line(uneven, 0.3)._is_convex(box, np.zeros(1))


def test_the_hole_contains_no_kink_of_the_rates() -> None:
    """The Hessian of g for x' = u - 0.02 max(x - 0.05, 0) is definite on both sides of the kink."""
    kinked = replace(
        SLED,
        equations=lambda x, u, p, w: (
            {"position": u.speed - 0.02 * ca.fmax(x.position - 0.05, 0.0)},
            {},
        ),
    )
    assert _on_a_line(kinked, 0.9375).hole == 5


def test_the_edge_with_largest_variation_is_halved() -> None:
    """A box is halved along the edge on which g, the left side of g >= 0, varies most.

    For a box at a face of the cube, the edge on which W varies most is halved. Here
    g = 1.5 y_1 u + y_1² + (a - 0.125) y_2² + u² with a = 0.25 or 4, and
    W = 0.75 y_1² + 0.0625 y_2².
    """
    W = Polynomial(2, ((0.75, (2, 0)), (0.0625, (0, 2))))
    boxes = Boxes(np.array([[0.375, 0.375], [0.5, 0.5]]), np.array([[3, 3], [1, 1]]))
    chosen = []
    for a in (0.25, 4.0):
        inequality = _of_two_states(W, 0.5, np.diag([1.0, a]), ONE)
        traced = inequality._values.traced(*_still(inequality, boxes))
        sharpened = inequality._values.sharpened(traced, np.zeros(2, dtype=int), np.arange(2))
        chosen.append(inequality.decisive_edges(boxes, sharpened.lowered_by))
    assert [edges.tolist() for edges in chosen] == [[0, 0], [1, 0]]


def _still(inequality: CostInequality, boxes: Boxes) -> Any:
    """Return the Taylor models of states and inputs on boxes. The inputs approximately minimize
    g.
    """
    v, slopes = inequality.best_inputs(boxes.centres)
    return inequality._inputs(boxes, Guess(v, slopes * boxes.half_widths[:, None, :]))


def pair(x: Any, u: Any, p: Any, w: Any) -> Any:
    fast = x.fast * x.slow - x.fast + u.push
    return {"fast": fast, "slow": 0.001 * (x.fast**2 - x.slow)}, {}


def inequality_of(
    W: Polynomial, M: np.ndarray, c: float, weights: tuple[float, float]
) -> CostInequality:
    """Return the cost inequality on {W <= c} for two states with different rates, with R = 1.

    M: (2, 2), y = M z
    weights: diagonal of Q
    """
    push = {"push": Signal("1", 1.0, -1.0, 1.0)}
    model = Model("pair", {"fast": Signal(), "slow": Signal()}, push, pair, trim={})
    plant = Plant(model, {}, {"fast": 0.0, "slow": 0.0}, {"push": 0.0}, {}, {"push": (-1.0, 1.0)})
    still = Equilibrium(np.zeros(3), np.zeros(3))
    return CostInequality(plant, still, Piece(M, W, c), np.diag(weights), np.eye(1))


def test_a_set_at_a_face_is_refuted() -> None:
    """A set {W <= c} that meets a face of the cube is refuted at a point of this face.

    W = 0.5 at the centers of the faces y_1 = ±1, and c = 0.6.
    """
    W = Polynomial(2, ((0.5, (2, 0)), (0.75, (0, 2))))
    inequality = inequality_of(W, np.eye(2), 0.6, (1.0, 1.0))
    with pytest.raises(RefutedError, match="beyond the boxes") as refuted:
        inequality.proved(1000)
    y = refuted.value.place
    assert np.abs(y).max() == 1.0
    assert W.at(y[None])[0] <= 0.6


def test_skewed_coordinates_leave_the_hole_large() -> None:
    """The hole around the equilibrium stays large for coordinates y = M z with large entries of M.

    The entries cancel in the scaled Hessian.
    """
    M = np.array([[1.0, 32.0], [0.0, 1.0]])
    # W = 0.25 fast² + 2 slow², with fast = y_1 - 32 y_2
    W = Polynomial(2, ((0.25, (2, 0)), (-16.0, (1, 1)), (258.0, (0, 2))))
    inequality = inequality_of(W, M, 1.0, (1.0, 0.0078125))
    assert inequality.hole <= 10


def test_guesses_stay_with_their_boxes() -> None:
    """The guesses of some boxes are those of these boxes, in their order."""
    numbers = np.arange(3.0)
    part = Guess(numbers[:, None], 10.0 * numbers[:, None, None]).part(np.array([2, 0]))
    assert part.value.ravel().tolist() == [2.0, 0.0]
    assert part.slopes.ravel().tolist() == [20.0, 0.0]
