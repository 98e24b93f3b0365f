"""Plants and loops of statements at a trim of the user's aircraft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
import scipy.linalg

from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import SAME_TRIM, Limits, Plant, limits_hold, model_limits
from hfa_prove.subject import Given, within
from hfa_support.errors import BadInputError, refuse_unknown

if TYPE_CHECKING:
    from hfa_flight.problem import FlightProblem
    from trim.linear.linear_model import LinearModel
    from trim.point.operating_point import OperatingPoint

#: If the condition number is larger, an input replaces a state as an unknown.
_CONDITION = 1e6


def plant_of(problem: FlightProblem) -> Plant:
    """Return the aircraft at the trim of a problem, with its envelope and input limits.

    Raises BadInputError if derivatives depend on a state that the cost omits. A bound would then be
    valid only while this state is constant.
    """
    model = problem.model
    if problem.carried:
        names = " and ".join(problem.carried)
        raise BadInputError(
            f"the rates of {model.title} depend on {names}, which the cost does not include; "
            "give an aircraft without these variables"
        )
    envelope = problem.envelope
    ends = zip(envelope.lowest.tolist(), envelope.highest.tolist(), strict=True)
    limits = dict(zip(envelope.names, ends, strict=True))
    limits |= {name: (signal.min, signal.max) for name, signal in model.inputs.items()}
    finite = {name: pair for name, pair in limits.items() if np.isfinite(pair).any()}
    return replace(plant_at(problem.point), limits=finite)


def loop_at(linear: LinearModel, policy: Gain | ca.Function, limits: Limits | None = None) -> Loop:
    """Return the closed loop of a policy about the trim of a linear model.

    limits: signal -> lowest and highest value, within the model's limits at the trim, which they
        replace; None for the model's

    Raises BadInputError if a limit is wider than the model's.
    """
    at = plant_at(linear.point)
    return Loop(**vars(replace(at, limits=limits_at(at, limits or {}))), policy=policy)


def limits_at(at: Plant, given: Limits) -> Limits:
    """Return the model's limits at a trim, in which the given ones replace those of the model.

    Raises BadInputError if a given limit is not that of a state, input or output, or is wider than
    the model's.
    """
    model = at.model
    names = (*model.states, *model.inputs, *model.outputs)
    for name in given:
        refuse_unknown("no state, input or output is called", name, names)
    own = model_limits(model, {**at.trim, **at.held}, at.parameters)
    wider = limits_hold({**own, **given}, own)
    if wider is not None:
        low, high = (model.describe(wider, end) for end in own[wider])
        raise BadInputError(
            f"the limits of {wider} are wider than the model's, {low} to {high}; narrow these "
            "limits"
        )
    return {**own, **given}


def plant_at(point: OperatingPoint) -> Plant:
    """Return the aircraft at a trim, without limits."""
    model = point.model
    states = {name: float(value) for name, value in point.states._asdict().items()}
    return Plant(
        model,
        parameters={name: signal.start for name, signal in model.parameters.items()},
        trim={name: states[name] for name in model.linear},
        inputs={name: float(value) for name, value in point.inputs._asdict().items()},
        held={name: value for name, value in states.items() if name not in model.linear},
        limits={},
    )


def unknowns_of(problem: FlightProblem, plant: Plant) -> tuple[int, ...]:
    """Return the indices of the n states or inputs for which the equilibrium equations are solved.

    The indices count the states, then the inputs. The n states are selected if their scaled
    Jacobian is well conditioned. Otherwise a QR decomposition with pivoting selects states and
    inputs.
    """
    n = len(plant.states)
    both = np.hstack([problem.linear.A, problem.linear.B])
    scaled = both / plant.nominal[:n, None] * plant.nominal[None, : both.shape[1]]
    if np.linalg.cond(scaled[:, :n]) < _CONDITION:
        return tuple(range(n))
    order = scipy.linalg.qr(scaled, mode="r", pivoting=True)[1]
    return tuple(sorted(order[:n].tolist()))


def given_of(problem: FlightProblem, option: str) -> dict[str, Given]:
    """Return the values in the user's problem that a certificate must state, by path in the
    certificate.

    option: the options that gave the problem, for messages

    Raises BadInputError if derivatives depend on a state that the cost omits.
    """
    plant = plant_of(problem)
    given = given_plant(plant, option, "plant.")
    given["plant.limits"] = Given(dict(plant.limits), option, _not_narrower)
    return given


def given_plant(plant: Plant, option: str, before: str = "") -> dict[str, Given]:
    """Return path of an entry -> the user's value, for every entry on the user's plant or loop.

    The values of its trim are compared within `SAME_TRIM` nominal values.

    option: the options that gave the plant, for messages
    before: beginning of every path, such as "plant."
    """
    widths = {name: SAME_TRIM * signal.nominal for name, signal in plant.model.signals.items()}
    given = {}
    for path, declared, value in plant.entries(before):
        if declared.subject == "trim":
            given[path] = Given(value, option, within(widths))
        elif declared.subject:
            given[path] = Given(value, option)
    return given


def _not_narrower(stated: Mapping[str, Any], own: Mapping[str, Any]) -> bool:
    """Return whether a certificate's limits contain the user's limits.

    stated: name -> (lowest, highest) in the certificate; None is no limit
    own: name -> (lowest, highest) of the user; a missing name has no limits
    """
    for name, (low, high) in stated.items():
        least, most = own.get(name, (-np.inf, np.inf))
        if (low is not None and least < low) or (high is not None and most > high):
            return False
    return True
