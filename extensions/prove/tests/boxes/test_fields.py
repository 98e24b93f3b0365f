"""Each field of a statement on boxes is compared with the user's input, or printed."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from as_proved import as_proved

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_flight.problem import flight_problem
from hfa_prove.commands.given_region import _same_coefficients, given_on_boxes
from hfa_prove.commands.region_boxes import ProvedPolicy, _given, loop_of
from hfa_prove.commands.request import CheckRequest
from hfa_prove.fields_boxes import COST_FIELDS, FIELDS
from hfa_prove.problem import given_of
from hfa_prove.report_boxes import checked_report
from hfa_prove.report_cost import checked_bound_report
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant, Subject
from hfa_prove.statements.region_boxes import BoxStatement, Gain, digest_of
from hfa_prove.subject import Given, compare, entries_of
from hfa_support.errors import BadInputError, NoSolutionError
from trim.point.linearize import linearize
from trim.point.solve import trim

Change = Callable[[Any], Any]
#: A cart with a parameter, a state that is held, and an output with limits.
CART = """
from hfa import Model, Signal

def cart(x, u, p, w):
    push = u.force - p.damping * x.speed + 0.0 * x.slope
    return {"place": x.speed, "speed": push, "slope": 0.0 * x.slope}, {"load": x.place}

CART = Model(
    "cart", {"place": Signal("m"), "speed": Signal("m/s"), "slope": Signal("rad", 1.0, -1.0, 1.0)},
    {"force": Signal("N", 1.0, -2.0, 2.0)}, cart, outputs={"load": Signal("m", 1.0, -9.0, 9.0)},
    parameters={"damping": Signal("1/s", start=0.5)}, linear=("place", "speed"),
    trim={"place": 0.0, "speed": 0.0, "slope": 0.25},
)
"""
K = np.array([[1.25, 1.5]])


@pytest.fixture(scope="module")
def aircraft(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return the aircraft as the option --aircraft accepts it, FILE:NAME."""
    file = tmp_path_factory.mktemp("fields") / "cart.py"
    file.write_text(CART)
    return f"{file}:CART"


@pytest.fixture(scope="module")
def cart(aircraft: str) -> Model:
    return load_model(aircraft)


def _first(change: Change) -> Change:
    """Return a function that applies `change` to the first number in nested lists or objects."""

    def changed(value: Any) -> Any:
        if isinstance(value, dict):
            first = next(iter(value))
            return value | {first: changed(value[first])}
        if isinstance(value, list):
            return [changed(value[0]), *value[1:]]
        return change(value)

    return changed


def _more(value: float) -> float:
    return 1.03 * value + 0.01


_PLANT: dict[str, list[Change]] = {
    "dynamics": [lambda name: f"{name}x"],
    "source": [lambda source: "0" * len(source)],
    "states": [lambda names: names[::-1]],
    "state_units": [lambda units: ["ft", *units[1:]]],
    "input_units": [lambda units: ["lbf"]],
    "parameters": [_first(_more)],
    "trim": [_first(_more)],
    "inputs": [_first(_more)],
    "held": [_first(_more)],
}
PIECE: list[Change] = [
    lambda piece: piece | {"c": 0.9 * piece["c"]},
    lambda piece: piece | {"M": _first(_more)(piece["M"])},
    lambda piece: piece | {"W": [[_more(piece["W"][0][0]), piece["W"][0][1]], *piece["W"][1:]]},
]
#: Path -> other entries of the statement about a region.
CHANGES: dict[str, list[Change]] = _PLANT | {
    "limits": [
        lambda limits: limits | {"force": [-2.0, 2.5]},
        lambda limits: limits | {"load": [-8.0, 9.0]},
        lambda limits: limits | {"place": [-8.0, 9.0]},
    ],
    "policy": [
        lambda policy: policy | {"K": _first(_more)(policy["K"])},
        lambda policy: policy | {"terms": {"force": [[-0.2, [3, 0]]]}},
    ],
    "equilibrium": [_first(_more)],
    "piece": PIECE,
    "extents": [_first(_more)],
}
COST_CHANGES: dict[str, list[Change]] = _PLANT | {
    "limits": [
        lambda limits: limits | {"force": [-2.0, 2.5]},
        lambda limits: limits | {"place": [-8.0, 9.0]},
    ],
    "Q": [_first(_more)],
    "R": [_first(_more)],
    "equilibrium": [_first(_more)],
    "pieces": [lambda pieces, change=change: [change(pieces[0])] for change in PIECE]
    + [lambda pieces: pieces * 2],
}


def piece(degree: int) -> Piece:
    terms = ((1.0, (2, 0)), (0.5, (1, 1)), (2.0, (0, 2)), (0.25, (4, 0)))
    return Piece(2.0 * np.eye(2), Polynomial(2, terms if degree > 2 else terms[:3]), 0.5)


def region(cart: Model, degree: int) -> BoxStatement:
    """Return the statement of a region, without a proof.

    degree: degree of V
    """
    linear = linearize(cart, trim(cart))
    gain = Gain(K, {"force": ((-0.1, (3, 0)),)})
    loop = loop_of(linear, ProvedPolicy.of_gain(gain, ("force",), "a gain", None))
    ends = dict.fromkeys(loop.states, (-1.0, 1.0))
    return BoxStatement(loop, gain, dict.fromkeys(loop.states, 0.0), piece(degree), ends)


def assert_walked(
    content: dict[str, Any],
    table: Any,
    given: dict[str, Given],
    changes: dict[str, list[Change]],
    text_of: Callable[[dict[str, Any]], str],
) -> None:
    """Assert that every change of every field is detected, refused or printed.

    content: the statement
    table: fields of the statement
    given: entry -> the user's value, from which a changed entry must differ
    changes: field -> changes of its value
    text_of: statement -> printed report
    """
    assert set(changes) == {name for name, _ in entries_of(content, table)} == set(table)
    original = text_of(content)
    walked = [(name, change) for name in changes for change in changes[name]]
    for name, change in walked:
        other = copy.deepcopy(content) | {name: change(copy.deepcopy(content[name]))}
        assert other != content, name
        if name in given:
            with pytest.raises(
                NoSolutionError, match="in the certificate differs from the value of"
            ):
                compare(other, table, given)
        try:
            shown = text_of(other)
        except (BadInputError, NoSolutionError):
            continue  # refused for all options
        assert shown != original, name


@pytest.mark.parametrize("degree", [2, 4])
def test_region_fields_are_compared_or_printed(degree: int, aircraft: str, cart: Model) -> None:
    """Each field of a region is compared with the user's input or printed."""

    def text_of(content: dict[str, Any]) -> str:
        statement = BoxStatement.read(content, Subject(cart))
        return checked_report(as_proved(statement), "the gain K").text()

    request = CheckRequest(model=cart, aircraft=aircraft, typed=frozenset({"aircraft"}))
    statement = region(cart, degree)
    given = given_on_boxes(statement, request)
    content = statement.content()
    given["policy"] = Given(content["policy"], "--weights", _same_coefficients)
    assert compare(content, FIELDS, given) == []
    for narrower in CHANGES["limits"][1:]:  # narrower limits imply the model's limits
        compare(content | {"limits": narrower(content["limits"])}, FIELDS, given)
    del given["limits"]
    assert_walked(content, FIELDS, given, CHANGES, text_of)


def test_the_digest_of_a_network_is_compared(cart: Model) -> None:
    """A network with other weights than the certificate's policy is refused."""
    linear = linearize(cart, trim(cart))
    gains = [Gain(gain, {}).function(("force",)) for gain in (K, 1.001 * K)]
    loops = [loop_of(linear, ProvedPolicy(gain, "a network")) for gain in gains]
    statement = BoxStatement(
        loops[0],
        digest_of(loops[0].policy),
        {"place": 0.0, "speed": 0.0},
        piece(2),
        dict.fromkeys(("place", "speed"), (-1.0, 1.0)),
    )
    content = statement.content()
    assert compare(content, FIELDS, _given(loops[0], "the user")) == []
    with pytest.raises(NoSolutionError, match="policy in the certificate differs"):
        compare(content, FIELDS, _given(loops[1], "the user"))
    with pytest.raises(BadInputError, match="another policy"):
        BoxStatement.read(content, Subject(cart, loops[1].policy))
    with pytest.raises(BadInputError, match="is about a policy in a file"):
        BoxStatement.read(content, Subject(cart))


def test_fields_of_bounds_are_compared_or_printed(cart: Model) -> None:
    """Each field of a cost bound is compared with the user's input or printed."""

    def text_of(content: dict[str, Any]) -> str:
        statement = CostStatement.read(content, Subject(cart))
        count = len(statement.pieces)
        verified = as_proved(statement, sizes=(1,) * count)
        return checked_bound_report(verified, []).text()

    problem = flight_problem(cart, trim(cart))
    given = given_of(problem, "--aircraft", {"Q": np.eye(2), "R": np.eye(1)})
    plant = region(cart, 2).loop
    limits = {name: ends for name, ends in plant.limits.items() if name != "load"}
    still = dict.fromkeys((*plant.states, "force"), 0.0)
    own = Plant(cart, plant.parameters, plant.trim, plant.inputs, plant.held, limits)
    content = CostStatement(own, still, np.eye(2), np.eye(1), (piece(4),)).content()
    assert compare(content, COST_FIELDS, given) == []
    narrower = COST_CHANGES["limits"][1](content["limits"])
    with pytest.raises(
        NoSolutionError, match="limit of place in the certificate differs"
    ):  # a claim about fewer flights
        compare(content | {"limits": narrower}, COST_FIELDS, given)
    del given["limits"]
    assert_walked(content, COST_FIELDS, given, COST_CHANGES, text_of)
