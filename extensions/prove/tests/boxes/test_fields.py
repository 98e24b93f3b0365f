"""Each field of a statement on boxes is compared with the user's input, or printed."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from as_proved import as_proved
from stored_certificates import ROOT, pendulum, read as read_stored, stored

from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model, Signal
from hfa_flight.problem import flight_problem
from hfa_prove.certificate import read_statement
from hfa_prove.commands.given_region import _not_wider, _same_policy, given_for
from hfa_prove.commands.policies import GivenPolicy
from hfa_prove.commands.request import CheckRequest, RegionRequest
from hfa_prove.fields import Stated
from hfa_prove.problem import given_of, given_plant
from hfa_prove.report_cost import checked_bound_report
from hfa_prove.report_region import checked_report
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.game import SAME_GAIN
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant, Subject, digest_of, digest_of_equations
from hfa_prove.statements.region import RegionStatement
from hfa_prove.subject import Given, close_to, compare
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


def _part(name: str, change: Change) -> Change:
    """Return a function that applies `change` to the entry `name` of an object."""
    return lambda value: value | {name: change(value[name])}


#: Entry of an aircraft -> other values.
_PLANT: dict[str, list[Change]] = {
    "model": [
        _part("dynamics", lambda name: f"{name}x"),
        _part("equations", lambda digest: "0" * len(digest)),
        _part("states", lambda names: names[::-1]),
        _part("steady", lambda names: names[:1]),
        _part("state_units", lambda units: ["ft", *units[1:]]),
        _part("input_units", lambda units: ["lbf"]),
        _part("disturbance_units", lambda units: ["lbf"]),
        _part("nominal", _first(_more)),
    ],
    "parameters": [_first(_more)],
    "trim": [_first(_more)],
    "inputs": [_first(_more)],
    "held": [_first(_more)],
}


def _of(holder: str, changes: Mapping[str, list[Change]]) -> dict[str, list[Change]]:
    """Return changes of entries with the path of the object that contains them."""
    return {f"{holder}.{name}": each for name, each in changes.items()}


PIECE: list[Change] = [
    lambda piece: piece | {"c": 0.9 * piece["c"]},
    lambda piece: piece | {"M": _first(_more)(piece["M"])},
    lambda piece: piece | {"W": [[_more(piece["W"][0][0]), piece["W"][0][1]], *piece["W"][1:]]},
]
#: Path -> other entries of the statement about a region.
CHANGES: dict[str, list[Change]] = {
    **_of("loop", _PLANT),
    "loop.limits": [
        lambda limits: limits | {"force": [-2.0, 2.5]},
        lambda limits: limits | {"load": [-8.0, 9.0]},
        lambda limits: limits | {"place": [-8.0, 9.0]},
    ],
    "loop.policy.K": [_first(_more)],
    "loop.policy.terms": [lambda terms: {"force": [[-0.2, [3, 0]]]}],
    "loop.disturbances": [lambda sizes: {"gust": 1.0}],
    "equilibrium": [_first(_more)],
    "piece": [*PIECE, _part("whole", lambda whole: not whole)],
    "extents": [_first(_more)],
}
COST_CHANGES: dict[str, list[Change]] = {
    **_of("plant", _PLANT),
    "plant.limits": [
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


def region(cart: Model, degree: int) -> RegionStatement:
    """Return the statement of a region, without a proof.

    degree: degree of V
    """
    linear = linearize(cart, trim(cart))
    gain = Gain(K, {"force": ((-0.1, (3, 0)),)})
    loop = GivenPolicy.of_gain(linear, gain, "a gain", None).problem.loop
    ends = dict.fromkeys(loop.states, (-1.0, 1.0))
    return RegionStatement(loop, dict.fromkeys(loop.states, 0.0), piece(degree), ends)


def with_changed(content: dict[str, Any], path: str, change: Change) -> dict[str, Any]:
    made = copy.deepcopy(content)
    *parents, last = path.split(".")
    holder = made
    for name in parents:
        holder = holder[name]
    holder[last] = change(holder[last])
    return made


def assert_walked(
    statement: Stated,
    given: dict[str, Given],
    changes: dict[str, list[Change]],
    read: Callable[[dict[str, Any]], Any],
    text_of: Callable[[Any], str],
) -> None:
    """Assert that every change of every entry is detected, refused or printed.

    given: path -> the user's value, from which a changed entry must differ
    changes: path -> changes of the entry
    read: content of a statement -> the statement
    text_of: statement -> printed report
    """
    assert set(changes) == {path for path, _, _ in statement.entries()}
    content = statement.content()
    original = text_of(statement)
    for path, change in [(each, change) for each in changes for change in changes[each]]:
        made = with_changed(content, path, change)
        assert made != content, path
        try:
            other = read(made)
        except (BadInputError, NoSolutionError):
            continue  # refused for all options
        if path in given:
            with pytest.raises(
                NoSolutionError, match="in the certificate differs from the value of"
            ):
                compare(other, given)
        assert text_of(other) != original, path


@pytest.mark.parametrize("degree", [2, 4])
def test_region_fields_are_compared_or_printed(degree: int, aircraft: str, cart: Model) -> None:
    """Each entry of a region is compared with the user's input or printed."""

    def read(content: dict[str, Any]) -> RegionStatement:
        made: RegionStatement = read_statement("region", content, Subject(cart))
        return made

    def text_of(statement: RegionStatement) -> str:
        return checked_report(as_proved(statement)).text()

    request = CheckRequest.parsed(cart, {"aircraft.source": aircraft})
    statement = region(cart, degree)
    given = given_for(statement, request)
    gain = statement.loop.gain.content()
    given["loop.policy.K"] = Given(gain["K"], "--weights", close_to(SAME_GAIN))
    given["loop.policy.terms"] = Given(gain["terms"], "--weights", _same_policy)
    assert compare(statement, given) == []
    for narrower in CHANGES["loop.limits"][1:]:  # narrower limits imply the model's limits
        compare(read(with_changed(statement.content(), "loop.limits", narrower)), given)
    del given["loop.limits"]
    assert_walked(statement, given, CHANGES, read, text_of)


def test_a_network_is_not_compared_with_a_polynomial_policy(aircraft: str, cart: Model) -> None:
    request = CheckRequest.parsed(cart, {"aircraft.source": aircraft, "weights": Path("net.onnx")})
    linear = linearize(cart, trim(cart))
    own = GivenPolicy(linear, ca.Function("u", [], []), None, "network", [])
    with pytest.raises(BadInputError, match="polynomial policy"):
        given_for(region(cart, 2), request, own=own)


def test_limits_in_a_certificate_may_be_narrower() -> None:
    """null is no limit. Limits of inputs must be equal; other limits must not be wider."""
    for stated, own, agrees in (
        ({"place": (None, 9.0)}, {"place": (-np.inf, 9.0)}, True),
        ({"place": (None, 9.0)}, {"place": (-8.0, 9.0)}, False),
        ({"place": (-8.0, None)}, {"place": (-8.0, 9.0)}, False),
        ({"place": (-8.0, None)}, {"place": (-8.0, np.inf)}, True),
        ({"place": (-7.0, 9.0)}, {"place": (-8.0, 9.0)}, True),
        ({"force": (-2.0, 3.0)}, {"force": (-2.0, 3.0)}, True),
        ({"force": (-1.0, 3.0)}, {"force": (-2.0, 3.0)}, False),
        ({}, {"place": (-8.0, 9.0)}, False),
    ):
        assert _not_wider(("force",) if "force" in own else ())(stated, own) is agrees


@pytest.mark.parametrize(
    ("terms", "agrees"),
    [
        ([[2.0, [3, 0]], [1.0, [0, 2]]], True),
        ([[1.0, [0, 2]], [2.0 * (1.0 + 0.5 * SAME_GAIN), [3, 0]]], True),
        ([[1.0, [0, 2]], [2.0 * (1.0 - 2.0 * SAME_GAIN), [3, 0]]], False),
        ([[2.0, [3, 0]], [1.0, [1, 1]]], False),
        ([[2.0, [3, 0]]], False),
    ],
)
def test_polynomial_policies_agree_to_their_tolerance(terms: list[Any], agrees: bool) -> None:
    own = {"force": [[2.0, [3, 0]], [1.0, [0, 2]]]}
    assert _same_policy({"force": terms}, own) is agrees
    assert not _same_policy({"force": terms, "flap": terms}, own)


def test_disturbances_of_a_region_are_compared_if_given() -> None:
    statement, _ = read_stored(stored("region_disturbed"))
    options = {"aircraft.source": f"{ROOT}/examples/pendulum.py:PENDULUM"}
    for sizes in ({}, {"push": 0.125}):
        request = RegionRequest.parsed(pendulum(), options | {"disturbance": sizes})
        given = given_for(statement, request)
        assert ("loop.disturbances" in given) is bool(sizes)
        if sizes:
            assert given["loop.disturbances"].value == sizes
            with pytest.raises(NoSolutionError, match="differs from the value of --disturbance"):
                compare(statement, given)


@pytest.mark.parametrize(
    ("old", "new", "is_same"),
    [
        ("def cart", "# A comment.\ndef cart", True),
        ("start=0.5", "start=0.6", True),
        ("push = ", "push = 1e-9 * x.place + ", False),
        ('"place": Signal("m")', '"place": Signal("ft")', False),
    ],
)
def test_the_graph_of_the_equations_identifies_a_file(
    old: str, new: str, is_same: bool, cart: Model, tmp_path: Path
) -> None:
    """A comment, a title or another default value leaves a certificate valid.

    Other equations or other units of states do not.
    """
    assert old in CART
    text = CART.replace(old, new, 1)
    file = tmp_path / "cart.py"
    file.write_text(text)
    read = load_model(f"{file}:CART")
    other = replace(read, about=replace(read.about, title="Another title"))
    content = region(cart, 2).content()
    if is_same:
        assert read_statement("region", content, Subject(other)).content() == content
    else:
        with pytest.raises((BadInputError, NoSolutionError), match=r"other equations|state_units"):
            read_statement("region", content, Subject(other))


def test_names_of_signals_are_in_the_digest() -> None:
    """Models with equal equations of signals with other names have different digests."""

    def falling(name: str) -> Model:
        return Model(
            "fall", {name: Signal("m")}, {}, lambda x, u, p, w: ({name: -x[0]}, {}), trim={}
        )

    assert digest_of_equations(falling("a")) == digest_of_equations(falling("a"))
    assert digest_of_equations(falling("a")) != digest_of_equations(falling("b"))


def test_tables_are_in_the_digest() -> None:
    """Functions that differ in one value of a table have different digests."""
    z = ca.SX.sym("z")
    digests = set()
    for middle in (1.0, 1.0, np.nextafter(1.0, 2.0)):
        table = ca.interpolant("table", "linear", [[0.0, 1.0, 2.0]], [0.0, middle, 4.0])
        digests.add(digest_of(ca.Function("f", [z], [table(z)])))
    assert len(digests) == 2


def test_derivatives_of_a_table_do_not_change_its_digest() -> None:
    """A digest is the same before and after CasADi computes derivatives of a smooth table."""
    z = ca.SX.sym("z")
    values = [0.0, 1.0, 4.0, 9.0, 1.0]
    table = ca.interpolant("table", "bspline", [[0.0, 1.0, 2.0, 3.0, 4.0]], values)
    before = digest_of(ca.Function("f", [z], [table(z)]))
    ca.hessian(table(z), z)
    assert digest_of(ca.Function("f", [z], [table(z)])) == before


def test_the_digest_of_a_network_is_compared(cart: Model) -> None:
    """A network with other weights than the certificate's policy is refused."""
    linear = linearize(cart, trim(cart))
    gains = [Gain(gain, {}).function(("force",)) for gain in (K, 1.001 * K)]
    policies = [GivenPolicy(linear, gain, None, "a network", []) for gain in gains]
    loops = [policy.problem.loop for policy in policies]
    statement = RegionStatement(
        loops[0],
        {"place": 0.0, "speed": 0.0},
        piece(2),
        dict.fromkeys(("place", "speed"), (-1.0, 1.0)),
    )
    content = statement.content()
    assert compare(statement, given_plant(loops[0], "the user", "loop.")) == []
    with pytest.raises(NoSolutionError, match="policy in the certificate differs"):
        compare(statement, given_plant(loops[1], "the user", "loop."))
    with pytest.raises(BadInputError, match="another policy"):
        read_statement("region", content, Subject(cart, loops[1].function))
    with pytest.raises(BadInputError, match="is about a policy in a file"):
        read_statement("region", content, Subject(cart))


def test_the_policy_of_the_user_is_compared_as_it_is_given(cart: Model, aircraft: str) -> None:
    """A network is compared whole, and never with a polynomial; without inputs there is none."""
    linear = linearize(cart, trim(cart))
    network = GivenPolicy(linear, Gain(K, {}).function(("force",)), None, "a network", [])
    polynomial = region(cart, 2)
    request = CheckRequest.parsed(cart, {"aircraft.source": aircraft})
    with pytest.raises(BadInputError, match="polynomial policy, not a network"):
        given_for(polynomial, request, network)
    of_network = replace(polynomial, loop=network.problem.loop)
    assert set(given_for(of_network, request, network)) >= {"loop.policy", "loop.trim"}
    assert "loop.policy.K" not in given_for(polynomial, request)
    free = f"{ROOT}/examples/pendulum.py:VAN_DER_POL"
    model = load_model(free)
    names = tuple(model.linear)
    loop = Loop(model, {}, dict.fromkeys(names, 0.0), {}, {}, {}, Gain(np.zeros((0, 2)), {}))
    still = RegionStatement.of_terms(loop, polynomial.terms, 0.5, {})
    given = given_for(still, CheckRequest.parsed(model, {"aircraft.source": free}))
    assert (given["loop.policy.K"].value, given["loop.policy.terms"].value) == ([], {})
    assert {"loop.model", "loop.trim", "loop.inputs", "loop.held", "loop.limits"} <= set(given)


def test_fields_of_bounds_are_compared_or_printed(cart: Model) -> None:
    """Each field of a cost bound is compared with the user's input or printed."""

    def read(content: dict[str, Any]) -> CostStatement:
        made: CostStatement = read_statement("cost", content, Subject(cart))
        return made

    def text_of(statement: CostStatement) -> str:
        count = len(statement.pieces)
        verified = as_proved(statement, sizes=(1,) * count)
        return checked_bound_report(verified, []).text()

    problem = flight_problem(cart, trim(cart))
    given = given_of(problem, "--aircraft", {"Q": np.eye(2), "R": np.eye(1)})
    plant = region(cart, 2).loop
    limits = {name: ends for name, ends in plant.limits.items() if name != "load"}
    still = dict.fromkeys((*plant.states, "force"), 0.0)
    own = Plant(cart, plant.parameters, plant.trim, plant.inputs, plant.held, limits)
    statement = CostStatement(own, still, np.eye(2), np.eye(1), (piece(4),))
    assert compare(statement, given) == []
    content = with_changed(statement.content(), "plant.limits", COST_CHANGES["plant.limits"][1])
    narrower = read(content)
    with pytest.raises(
        NoSolutionError, match="limit of place in the certificate differs"
    ):  # a claim about fewer flights
        compare(narrower, given)
    del given["plant.limits"]
    assert_walked(statement, given, COST_CHANGES, read, text_of)
