"""The user's data in the form of a region's statement, for comparison with a certificate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_boxes.check.plant import facts, limits_hold, model_limits
from hfa_boxes.check.statement import BoxStatement
from hfa_proof.checker.aircraft import SAME_TRIM
from hfa_proof.checker.reading import rows_of
from hfa_proof.checker.riccati import SAME_GAIN
from hfa_proof.commands.given import aircraft_option, at_one_value, names_aircraft
from hfa_proof.subject import Given, close_to, within
from hfa_region.check.statement import RegionStatement, facts_of

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from hfa_proof.commands.check import CheckRequest
    from hfa_region.commands.region import RegionRequest

#: Options that define a policy.
_OF_THE_POLICY = ("weights", "Q", "R", "delta", "basis")


def given_for(
    statement: RegionStatement, request: CheckRequest | RegionRequest
) -> dict[str, Given]:
    """Return path of an entry -> the user's value, for a region proved by sums of squares.

    statement: the proved statement
    request: options of the command

    Raises BadInputError or NoSolutionError if the options do not define a loop.
    """
    request = at_one_value(request)
    given: dict[str, Given] = {}
    at_a_trim = request.own or request.at is not None
    if names_aircraft(request):
        given |= _given_aircraft(statement, request)
    if at_a_trim:
        given |= _given_trim(request)
    if any(name in request.typed for name in _OF_THE_POLICY):
        given |= _given_policy(request)
    elif not statement.loop.inputs and "dynamics" in given:
        option = given["dynamics"].option
        given |= {"K": Given([], option), "policy": Given({}, option)}
    sizes = getattr(request, "disturbance", None)
    if sizes:
        given["disturbances"] = Given(dict(sizes), "--disturbance")
    return given


def given_on_boxes(
    statement: BoxStatement, request: CheckRequest | RegionRequest
) -> dict[str, Given]:
    """Return path of an entry -> the user's value, for a region proved on boxes.

    statement: the proved statement, with the coefficients of its policy
    request: options of the command

    Raises BadInputError or NoSolutionError if the options do not define a loop.
    """
    given: dict[str, Given] = {}
    at_a_trim = request.own or request.at is not None
    if names_aircraft(request):
        model = request.flown_aircraft()
        option = aircraft_option(request)
        parameters = {name: signal.start for name, signal in model.parameters.items()}
        given = {name: Given(fact, option) for name, fact in facts(model).items()}
        given["parameters"] = Given(parameters, option)
        if tuple(model.linear) == statement.loop.states:
            states = {**statement.loop.trim, **statement.loop.held}
            limits = model_limits(model, states, parameters)
            given["limits"] = Given(limits, option, _not_wider(tuple(model.inputs)))
    if at_a_trim:
        given |= _given_trim(request)
    if any(name in request.typed for name in _OF_THE_POLICY):
        of_squares = _given_policy(request)
        own = {"K": of_squares["K"].value, "terms": of_squares["policy"].value}
        given["policy"] = Given(own, of_squares["K"].option, _same_coefficients)
    return given


def _same_coefficients(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
    same_gain = close_to(SAME_GAIN)(stated["K"], own["K"])
    return same_gain and _same_policy(stated["terms"], own["terms"])


def _given_aircraft(
    statement: RegionStatement, request: CheckRequest | RegionRequest
) -> dict[str, Given]:
    """Return the entries on the user's model, its parameters, and its limits at the stated trim.

    The limits are omitted if the model has other moving states than the statement.
    """
    model = request.flown_aircraft()
    option = aircraft_option(request)
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    given = {name: Given(fact, option) for name, fact in facts_of(model).items()}
    given["parameters"] = Given(parameters, option)
    if tuple(model.linear) != statement.loop.states:
        return given  # another model, which the comparison of its name reports
    states = {**statement.loop.trim, **statement.loop.held}
    given["limits"] = Given(
        model_limits(model, states, parameters), option, _not_wider(tuple(model.inputs))
    )
    return given


def _not_wider(inputs: tuple[str, ...]) -> Any:
    """Return a comparison of limits by `limits_hold`.

    The comparison has the arguments (limits in the certificate, user's limits). The limits agree if
    all stated limits are admissible.

    inputs: names of the inputs
    """

    def same(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
        pairs = {name: _ends(pair) for name, pair in stated.items()}
        return limits_hold(pairs, own, inputs) is None

    return same


def _ends(pair: Any) -> tuple[float, float]:
    low, high = pair
    return (-np.inf if low is None else low, np.inf if high is None else high)


def _given_trim(request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries on the trim that the options define, to be compared within `SAME_TRIM`."""
    model: Model = request.flown_aircraft()
    point = request.operating_point(model)
    option = aircraft_option(request)
    values = {name: float(value) for name, value in point.states._asdict().items()}
    parts = {
        "trim": {name: values[name] for name in model.linear},
        "held": {name: values[name] for name in model.states if name not in model.linear},
        "inputs": {name: float(value) for name, value in point.inputs._asdict().items()},
    }
    widths = {name: SAME_TRIM * signal.nominal for name, signal in model.signals.items()}
    return {name: Given(part, option, within(widths)) for name, part in parts.items()}


def _given_policy(request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries `K` and `policy`, gain and nonlinear terms, of the user's policy."""
    from hfa_region.commands.policy import loop_of

    _, K, _, policy = loop_of(request)
    option = "the game" if request.weights is None else f"--weights {request.weights}"
    rows = {name: rows_of(terms) for name, terms in policy.items()}
    return {
        "K": Given(K.tolist(), option, close_to(SAME_GAIN)),
        "policy": Given(rows, option, _same_policy),
    }


def _same_policy(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
    """Return whether two polynomial policies agree.

    For each input, the monomials must be equal and the coefficients must agree within `SAME_GAIN`.

    stated: policy in the certificate, input -> terms
    own: the user's policy, input -> terms
    """
    if set(stated) != set(own):
        return False
    for name, rows in own.items():
        found = {tuple(powers): coefficient for coefficient, powers in stated[name]}
        wanted = {tuple(powers): coefficient for coefficient, powers in rows}
        if set(found) != set(wanted):
            return False
        pairs = [[found[powers], wanted[powers]] for powers in wanted]
        first, second = np.array(pairs).T
        if not close_to(SAME_GAIN)(first, second):
            return False
    return True
