"""The user's data in the form of a statement, for comparison with a certificate."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from hfa.options.advice import trimmed
from hfa.options.games import given_weights
from hfa.options.option import is_given, refuse
from hfa.options.ranges import array_of, single_value
from hfa.options.trims import OF_THE_TRIM, GivenTrim, at_name, trim_input
from hfa_aircraft.model import Model
from hfa_prove.certificate import kind_of
from hfa_prove.commands.options import interval_of
from hfa_prove.commands.policies import GivenPolicy, given_policy
from hfa_prove.commands.request import CheckRequest, disturbances_of
from hfa_prove.fields import rows_of
from hfa_prove.problem import given_plant, limits_at, plant_at
from hfa_prove.statements.loop import SAME_GAIN, Gain
from hfa_prove.statements.plant import SAME_TRIM, limits_hold
from hfa_prove.statements.region import RegionStatement
from hfa_prove.statements.schedule import ScheduleStatement
from hfa_prove.subject import Given, close_to, within
from hfa_support.errors import BadInputError

#: Options that name an aircraft or its trim.
_OF_THE_AIRCRAFT = ("aircraft", "dynamics", "parameters", *OF_THE_TRIM)
#: Options that define a policy or gains.
_OF_THE_POLICY = ("weights", "policy", "basis", "network", "set", "N", "delta", "Q", "R")
#: Options that do not apply to the certificate of a schedule.
_NOT_OF_SCHEDULES = ("policy", "basis", "network", "set", "disturbance", "start")


class CheckedTrim(NamedTuple):
    """The trim, or trims, that a certificate must be about.

    given: the trim; of a schedule without the value of the scheduling variable
    ends: value or ends of the scheduling variable, as typed, or ()
    """

    given: GivenTrim
    ends: tuple[float, ...]


def refuse_unfit(request: CheckRequest, kind: str) -> None:
    """Raise BadInputError for an option that does not apply to certificates of a kind."""
    if kind == "schedule":
        reason = "does not apply to the certificate of a schedule; remove this option"
        refuse(request, _NOT_OF_SCHEDULES, reason)


def checked_trim(request: CheckRequest, kind: str) -> CheckedTrim:
    """Return the trim that the options define for a certificate of a kind.

    Raises BadInputError if several values are given for the certificate of a region.
    """
    asked = trim_input(request, scheduled=interval_of)
    model = asked.model
    ends = () if asked.at is None else tuple(array_of("--at", asked.at, 2).tolist())
    at = None
    if ends and kind != "schedule":
        typed = single_value(f"--{at_name(model)}", ends)
        at = math.radians(typed) if model.is_typed_in_degrees else typed
    return CheckedTrim(asked.trim(at, asked.held()), ends)


def _names_one(request: CheckRequest, names: tuple[str, ...]) -> bool:
    """Return whether one of these options is given."""
    return any(is_given(request, name) for name in names)


def given_for(
    statement: Any, request: CheckRequest, trim: CheckedTrim, own: GivenPolicy | None
) -> dict[str, Given]:
    """Return path of an entry of the statement -> the value that the user's options give.

    own: the user's policy, if it is a network or a deployed policy

    Raises BadInputError or NoSolutionError if the options do not define the subject.
    """
    of_kind: Mapping[str, Callable[..., dict[str, Given]]] = {
        "schedule": _of_schedule,
        "region": _of_region,
    }
    return of_kind[kind_of(statement)](statement, request, trim, own)


def _of_schedule(
    statement: ScheduleStatement, request: CheckRequest, trim: CheckedTrim, _: Any
) -> dict[str, Given]:
    from hfa_prove.commands.schedule import gains_of_file
    from hfa_prove.search.family import Family, exact_gains

    flight = statement.flight
    given = {}
    if trim.ends:
        given["flight.range"] = Given([trim.ends[0], trim.ends[-1]])
    family = Family(trim.given.model, trim.given.common)
    if _names_one(request, _OF_THE_AIRCRAFT):
        content = family.flight(flight.low, flight.high).content()
        for name in ("model", "parameters", "imposed", "limits"):
            given[f"flight.{name}"] = Given(content[name])
        widths = {name: SAME_TRIM * flight.model.signals[name].nominal for name in flight.unknowns}
        given["flight.first"] = Given(content["first"], same=within(widths))
    if request.weights is not None:
        refuse(
            request,
            ("delta", "Q", "R", "N"),
            "cannot be combined with --weights, which gives the gains; remove this option",
        )
        gains, same = gains_of_file(request.weights, trim.given.model), close_to(0.0)
    elif _names_one(request, _OF_THE_POLICY):
        weights = given_weights(request)
        gains = exact_gains(family, statement.gains.breakpoints, **weights)
        same = close_to(SAME_GAIN, sizes_of_gain(trim.given.model))
    else:
        return given
    given["gains.breakpoints"] = Given(gains.breakpoints)
    given["gains.K"] = Given(gains.K, same=same)
    return given


def _of_region(
    statement: RegionStatement, request: CheckRequest, trim: CheckedTrim, own: GivenPolicy | None
) -> dict[str, Given]:
    loop = statement.loop
    limits = trim.given.common.limits
    given: dict[str, Given] = {}
    if own is not None:
        if isinstance(loop.policy, Gain):
            raise BadInputError(
                "the certificate is about a polynomial policy, not a network or a deployed policy; "
                "give the file of the proved gain or critic as --weights"
            )
        given = given_plant(own.problem(limits).loop, "loop.")
    else:
        if _names_one(request, _OF_THE_AIRCRAFT) or trim.ends:
            plant = plant_at(trimmed(trim.given))
            given = given_plant(plant, "loop.")
            at_stated_trim = replace(plant, trim=loop.trim, held=loop.held)
            stated = limits_at(at_stated_trim, limits)
            given["loop.limits"] = Given(stated, same=_not_wider(tuple(plant.model.inputs)))
        if _names_one(request, _OF_THE_POLICY) or (given and not loop.inputs):
            given |= _given_policy(request, trim.given)
    if request.disturbance:
        given["loop.disturbances"] = Given(disturbances_of(request, trim.given.model))
    return given


def _not_wider(inputs: tuple[str, ...]) -> Callable[[Any, Any], bool]:
    """Return a comparison by `limits_hold`; the limits of the inputs must be equal."""

    def same(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
        pairs = {
            name: (-np.inf if low is None else low, np.inf if high is None else high)
            for name, (low, high) in stated.items()
        }
        return limits_hold(pairs, own, inputs) is None

    return same


def _given_policy(request: CheckRequest, trim: GivenTrim) -> dict[str, Given]:
    """Return the entries `policy.K` and `policy.terms`, of the user's policy."""
    gain = given_policy(request, trim).gain
    assert gain is not None  # the caller found no function
    rows = {name: rows_of(terms) for name, terms in gain.terms.items()}
    close = close_to(SAME_GAIN, sizes_of_gain(trim.model))
    return {
        "loop.policy.K": Given(gain.K.tolist(), same=close),
        "loop.policy.terms": Given(rows, same=same_terms(trim.model)),
    }


def sizes_of_gain(model: Model) -> np.ndarray:
    """Return the typical sizes (m, n) of the entries of a gain, which depend on units as K does."""
    inputs = [signal.nominal for signal in model.inputs.values()]
    return np.outer(inputs, 1.0 / _nominal(model))


def _nominal(model: Model) -> np.ndarray:
    return np.array([model.states[name].nominal for name in model.linear])


def same_terms(model: Model) -> Callable[[Any, Any], bool]:
    """Return a comparison of policies, input -> terms, with coefficients within `SAME_GAIN`."""

    def same(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
        if set(stated) != set(own):
            return False
        for name, rows in own.items():
            found = {tuple(powers): coefficient for coefficient, powers in stated[name]}
            wanted = {tuple(powers): coefficient for coefficient, powers in rows}
            if set(found) != set(wanted):
                return False
            sizes = [1.0 / np.prod(_nominal(model) ** powers) for powers in wanted]
            close = close_to(SAME_GAIN, np.array(sizes))
            if not close([found[powers] for powers in wanted], list(wanted.values())):
                return False
        return True

    return same
