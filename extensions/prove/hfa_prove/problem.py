"""Plants and loops of statements at a trim of the user's aircraft."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca

from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.plant import SAME_TRIM, Limits, Plant, limits_hold, model_limits
from hfa_prove.subject import Given, within
from hfa_support.errors import BadInputError, refuse_unknown

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel
    from trim.point.operating_point import OperatingPoint


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


def given_plant(plant: Plant, before: str = "") -> dict[str, Given]:
    """Return path of an entry -> the user's value, for every entry on the user's plant or loop.

    The values of its trim are compared within `SAME_TRIM` nominal values.

    before: beginning of every path, such as "plant."
    """
    widths = {name: SAME_TRIM * signal.nominal for name, signal in plant.model.signals.items()}
    given = {}
    for path, declared, value in plant.entries(before):
        if declared.subject == "trim":
            given[path] = Given(value, within(widths))
        elif declared.subject:
            given[path] = Given(value)
    return given
