"""Access to the points of a sweep: linear models, and columns of values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.signals import record
from hfa_support.errors import NoSolutionError, refuse_unknown
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint
from trim.point.status import Status
from trim.sweeps.points import condition_at, model_at

if TYPE_CHECKING:
    from trim.sweeps.sweep import Sweep


def linear_model_at(swept: Sweep, index: int) -> LinearModel:
    """Return the linear model of a point of a sweep, with its operating point.

    index: number of the point; negative numbers count from the end

    Raises IndexError if there is no such point, and NoSolutionError, with the reason, if the point
    has no trim.
    """
    count = len(swept.reasons)
    if not -count <= index < count:
        raise IndexError(f"point {index} does not exist; choose from {-count} to {count - 1}")
    index %= count
    if swept.reasons[index]:
        raise NoSolutionError(
            f"point {index} has no trim: {swept.reasons[index]}; choose a trimmed point"
        )
    values = swept.values[index]
    model = model_at(swept.model, swept.variables, values)
    condition = condition_at(swept.plan.condition, swept.variables, values)
    states = record(tuple(model.states))(*swept.states[index].tolist())
    inputs = record(tuple(model.inputs))(*swept.inputs[index].tolist())
    found = OperatingPoint(states, inputs, {}, Status.TRIMMED, model)
    problem = found.problem_of(condition)
    point = OperatingPoint.of(problem, problem.unknowns(found.values), Status.TRIMMED)
    return point.linearize()


def column(swept: Sweep, name: str) -> np.ndarray:
    """Return the values of a swept variable, a state or an input at all points of a sweep, (N,).

    Raises BadInputError for any other name.
    """
    names = (*swept.variables, *swept.model.states, *swept.model.inputs)
    refuse_unknown("unknown variable", name, names)
    return np.hstack([swept.values, swept.states, swept.inputs])[:, names.index(name)]
