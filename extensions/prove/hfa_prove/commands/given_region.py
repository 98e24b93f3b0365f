"""The user's data in the form of a region's statement, for comparison with a certificate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_prove.commands.given import aircraft_option, at_one_value, names_aircraft
from hfa_prove.commands.policies import GivenPolicy, given_policy
from hfa_prove.fields import rows_of
from hfa_prove.problem import given_plant, plant_at
from hfa_prove.statements.game import SAME_GAIN
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import facts, limits_hold, model_limits
from hfa_prove.statements.region import RegionStatement
from hfa_prove.subject import Given, close_to
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_prove.commands.request import CheckRequest, RegionRequest

#: Options that define a policy.
_OF_THE_POLICY = (
    "weights",
    "game.weights.Q",
    "game.weights.R",
    "game.weights.delta",
    "reading.basis",
)


def given_for(
    statement: RegionStatement,
    request: CheckRequest | RegionRequest,
    own: GivenPolicy | None = None,
) -> dict[str, Given]:
    """Return path of an entry of a region -> the value that the user's options give.

    statement: the statement
    request: options of the command
    own: the user's policy, if it is a network or a deployed policy

    Raises BadInputError or NoSolutionError if the options do not define a loop, or define another
    kind of policy.
    """
    loop = statement.loop
    if own is not None:
        if isinstance(loop.policy, Gain):
            raise BadInputError(
                "the certificate is about a polynomial policy, not a network or a deployed policy; "
                "give the file of the proved gain or critic as --weights"
            )
        return given_plant(own.problem.loop, "the user", "loop.")
    request.refuse(
        ("policy", "reading.network", "reading.set"),
        "applies to a policy in a file, but the certificate is about a polynomial policy; "
        "remove this option",
    )
    request = at_one_value(request)
    given: dict[str, Given] = {}
    if names_aircraft(request):
        given |= _given_aircraft(loop, request)
    if request.aircraft.own or request.trim.at is not None:
        given |= _given_trim(request)
    if any(name in request.typed for name in _OF_THE_POLICY):
        given |= _given_policy(request)
    elif not loop.inputs and "model" in given:
        option = given["model"].option
        given |= {"policy.K": Given([], option), "policy.terms": Given({}, option)}
    sizes = getattr(request, "disturbance", None)
    if sizes:
        given["disturbances"] = Given(dict(sizes), "--disturbance")
    return {f"loop.{path}": value for path, value in given.items()}


def _given_aircraft(loop: Loop, request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries on the user's model, its parameters, and its limits at the stated trim.

    The limits are omitted if the model has other moving states than the statement.
    """
    model = request.trim.aircraft
    option = aircraft_option(request)
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    given = {"model": Given(facts(model), option), "parameters": Given(parameters, option)}
    if tuple(model.linear) != loop.states:
        return given  # another model, which the comparison of its name reports
    limits = model_limits(model, {**loop.trim, **loop.held}, parameters)
    given["limits"] = Given(limits, option, _not_wider(tuple(model.inputs)))
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
    given = given_plant(plant_at(request.trim.point()), aircraft_option(request))
    return {name: given[name] for name in ("trim", "inputs", "held")}


def _given_policy(request: CheckRequest | RegionRequest) -> dict[str, Given]:
    """Return the entries `policy.K` and `policy.terms`, of the user's policy."""
    gain = given_policy(request).gain
    assert gain is not None  # the caller found no function
    option = "the game" if request.weights is None else f"--weights {request.weights}"
    rows = {name: rows_of(terms) for name, terms in gain.terms.items()}
    return {
        "policy.K": Given(gain.K.tolist(), option, close_to(SAME_GAIN)),
        "policy.terms": Given(rows, option, _same_policy),
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
