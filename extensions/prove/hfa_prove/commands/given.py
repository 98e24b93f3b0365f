"""The user's data in the form of a statement, for comparison with a certificate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hfa.options.trim import OF_THE_TRIM, called_at
from hfa_prove.certificate import kind_of
from hfa_prove.commands.policies import GivenPolicy, given_policy
from hfa_prove.commands.request import CheckRequest
from hfa_prove.fields import rows_of
from hfa_prove.problem import given_plant, limits_at, plant_at
from hfa_prove.statements.loop import SAME_GAIN, Gain
from hfa_prove.statements.plant import SAME_TRIM, limits_hold
from hfa_prove.statements.region import RegionStatement
from hfa_prove.statements.schedule import ScheduleStatement
from hfa_prove.subject import Given, close_to, within
from hfa_support.errors import BadInputError

#: Options that name an aircraft or its trim.
_OF_THE_AIRCRAFT = (
    "aircraft.source",
    "aircraft.dynamics",
    "aircraft.parameters",
    *(f"trim.{name}" for name in OF_THE_TRIM),
)
#: Beginnings of the paths of options that define a policy or gains.
_OF_THE_POLICY = ("weights", "policy", "reading.", "game.")
#: Subject of an entry (`Entry.subject`), or path of an entry without a subject -> paths of the
#: options that give its value.
_GIVEN_BY: Mapping[str, tuple[str, ...]] = {
    "aircraft": ("aircraft.source", "aircraft.dynamics"),
    "parameters": ("aircraft.parameters", "aircraft.mass"),
    "trim": tuple(f"trim.{name}" for name in ("at", *OF_THE_TRIM)),
    "limits": ("trim.limit", "trim.given"),
    "policy": _OF_THE_POLICY,
    "gains": _OF_THE_POLICY,
    "flight.range": ("trim.at",),
    "loop.disturbances": ("disturbance",),
}
#: Paths of options that do not apply to the certificate of a schedule.
_NOT_OF_SCHEDULES = ("policy", "reading.", "disturbance", "trim.start")


def _typed(request: CheckRequest, paths: tuple[str, ...]) -> list[str]:
    """Return the given options: with one of these paths, or inside one that ends in a dot."""
    return [
        name
        for name in request.typed
        if any(name == path or (path.endswith(".") and name.startswith(path)) for path in paths)
    ]


def refuse_unfit(request: CheckRequest, kind: str) -> None:
    """Raise BadInputError for an option that does not apply to certificates of a kind."""
    if kind == "schedule":
        request.refuse(
            _typed(request, _NOT_OF_SCHEDULES),
            "does not apply to the certificate of a schedule; remove this option",
        )


def names_aircraft(request: CheckRequest) -> bool:
    """Return whether an option that defines the aircraft or its trim is given."""
    return any(name in request.typed for name in _OF_THE_AIRCRAFT)


def _options(request: CheckRequest, *of: str) -> str:
    """Return the given options of the first key of `_GIVEN_BY` that has any, joined by "and"."""
    for key in of:
        typed = _typed(request, _GIVEN_BY.get(key, ()))
        if typed:
            return " and ".join(request.typed[name] for name in typed)
    return "the default aircraft"


def _option_of_each(request: CheckRequest, subject: str) -> dict[str, str]:
    """Return variable -> the option that gives its trim value, parameter or limits."""
    if subject == "limits":
        of_file = {} if request.trim.given is None else request.trim.common_condition.limits
        return dict.fromkeys(of_file, "--condition") | dict.fromkeys(request.trim.limit, "--limit")
    held = dict.fromkeys(request.trim.hold, "--hold")
    if request.trim.at is not None:
        held[request.model.schedule] = f"--{called_at(request.model)}"
    return held


def at_one_value(request: CheckRequest) -> CheckRequest:
    """Return the request with its one scheduling value in the unit of the model.

    Raises BadInputError if several values are given.
    """
    if request.trim.at is None:
        return request
    if len(request.trim.at) != 1:
        raise BadInputError(f"--{called_at(request.model)} is an interval; give one value")
    (typed,) = request.trim.at
    in_degrees = request.model.is_typed_in_degrees
    at = math.radians(typed) if in_degrees else typed
    return replace(request, trim=replace(request.trim, at=at))


def given_for(statement: Any, request: CheckRequest, own: GivenPolicy | None) -> dict[str, Given]:
    """Return path of an entry of the statement -> the value that the user's options give.

    own: the user's policy, if it is a network or a deployed policy

    Raises BadInputError or NoSolutionError if the options do not define the subject.
    """
    of_kind: Mapping[str, Callable[..., dict[str, Given]]] = {
        "schedule": _of_schedule,
        "region": _of_region,
    }
    given = of_kind[kind_of(statement)](statement, request, own)
    subjects = {path: declared.subject for path, declared, _ in statement.entries()}
    named = {}
    for path, value in given.items():
        subject = subjects.get(path, "")
        option = _options(request, path, subject, "aircraft", "trim", "limits")
        named[path] = value._replace(option=option, option_of=_option_of_each(request, subject))
    return named


def _of_schedule(statement: ScheduleStatement, request: CheckRequest, _: Any) -> dict[str, Given]:
    from hfa_prove.commands.schedule import gains_of_file
    from hfa_prove.search.family import Family, exact_gains

    flight = statement.flight
    given = {}
    if request.trim.at:
        given["flight.range"] = Given([request.trim.at[0], request.trim.at[-1]])
    family = Family(request.trim.aircraft, request.trim.common_condition)
    if names_aircraft(request):
        content = family.flight(flight.low, flight.high).content()
        for name in ("model", "parameters", "imposed", "limits"):
            given[f"flight.{name}"] = Given(content[name])
        widths = {name: SAME_TRIM * flight.model.signals[name].nominal for name in flight.unknowns}
        given["flight.first"] = Given(content["first"], same=within(widths))
    policy = _typed(request, _OF_THE_POLICY)
    if request.weights is not None:
        request.game.weights.refuse(
            ("delta", "Q", "R", "N"),
            "cannot be combined with --weights, which gives the gains; remove this option",
        )
        gains, same = gains_of_file(request.weights, request.model), close_to(0.0)
    elif policy:
        weights = request.game.weights.changed
        gains = exact_gains(family, statement.gains.breakpoints, **weights)
        same = close_to(SAME_GAIN)
    else:
        return given
    given["gains.breakpoints"] = Given(gains.breakpoints)
    given["gains.K"] = Given(gains.K, same=same)
    return given


def _of_region(
    statement: RegionStatement, request: CheckRequest, own: GivenPolicy | None
) -> dict[str, Given]:
    loop = statement.loop
    request = at_one_value(request)
    given: dict[str, Given] = {}
    if own is not None:
        if isinstance(loop.policy, Gain):
            raise BadInputError(
                "the certificate is about a polynomial policy, not a network or a deployed policy; "
                "give the file of the proved gain or critic as --weights"
            )
        given = given_plant(own.problem(request.trim).loop, "", "loop.")
    else:
        if names_aircraft(request) or request.trim.at is not None:
            plant = plant_at(request.trim.point())
            given = given_plant(plant, "", "loop.")
            at_stated_trim = replace(plant, trim=loop.trim, held=loop.held)
            limits = limits_at(at_stated_trim, request.trim.common_condition.limits)
            given["loop.limits"] = Given(limits, same=_not_wider(tuple(plant.model.inputs)))
        if _typed(request, _OF_THE_POLICY) or (given and not loop.inputs):
            given |= _given_policy(request)
    if request.disturbance:
        given["loop.disturbances"] = Given(dict(request.disturbance))
    return given


def _not_wider(inputs: tuple[str, ...]) -> Callable[[Any, Any], bool]:
    """Return a comparison of (limits in the certificate, user's limits) by `limits_hold`.

    inputs: names of the inputs, whose limits must be equal
    """

    def same(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
        pairs = {
            name: (-np.inf if low is None else low, np.inf if high is None else high)
            for name, (low, high) in stated.items()
        }
        return limits_hold(pairs, own, inputs) is None

    return same


def _given_policy(request: CheckRequest) -> dict[str, Given]:
    """Return the entries `policy.K` and `policy.terms`, of the user's policy."""
    gain = given_policy(request).gain
    assert gain is not None  # the caller found no function
    rows = {name: rows_of(terms) for name, terms in gain.terms.items()}
    return {
        "loop.policy.K": Given(gain.K.tolist(), same=close_to(SAME_GAIN)),
        "loop.policy.terms": Given(rows, same=_same_policy),
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
