"""Margins between the variables of a trim and their limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.limits import NEAR
from hfa_aircraft.model import Model
from hfa_aircraft.signals import recognized
from hfa_support.native.bound import RowFunction
from hfa_support.reporting.results import Result
from trim.point.condition import TrimCondition


@dataclass(frozen=True)
class Margin(Result):
    """Variable of a trim with its limits, in its unit.

    name: name of the variable
    value: value at the trim
    role: "free" for an unknown of the trim, "held" at an imposed value, "left" at its start value
        because no equation determines the variable, or "follows" for any other state or output
    lowest: lower limit, -inf if the variable has none
    highest: upper limit, inf if the variable has none
    unit: unit of value, lowest, highest and scale
    scale: nominal size of the variable
    assumed: whether the limits are assumptions of the reader of the aircraft
    """

    name: str
    value: float
    role: str
    lowest: float
    highest: float
    unit: str
    scale: float
    assumed: bool = False

    @property
    def distance(self) -> float:
        """Distance to the nearer limit, min(value - lowest, highest - value).

        The distance is negative beyond the limit, and infinite without limits.
        """
        return min(self.value - self.lowest, self.highest - self.value)

    @property
    def nearer(self) -> str:
        """Name of the nearer limit, "lowest" or "highest", or "" without limits."""
        if math.isinf(self.distance):
            return ""
        return "lowest" if self.value - self.lowest <= self.highest - self.value else "highest"

    @property
    def nearer_limit(self) -> float:
        """Value of the nearer limit."""
        return self.lowest if self.nearer == "lowest" else self.highest

    @property
    def share(self) -> float:
        """Distance to the nearer limit, as a fraction of highest - lowest: 0 at a limit, 0.5
        halfway.

        The share is 0 if only one of the limits is finite, nan without limits, and `distance` if
        the limits are equal.
        """
        return self.distance / (self.highest - self.lowest or 1.0)

    @property
    def used(self) -> float:
        """Used share of the travel from rest toward the limit on the side of the value.

        Rest is 0, or the nearer of the limits if 0 is beyond them. The share is nan without a limit
        on this side.
        """
        rest = min(max(0.0, self.lowest), self.highest)
        travel = (self.highest if self.value >= rest else self.lowest) - rest
        return (self.value - rest) / travel if math.isfinite(travel) and travel else math.nan

    @property
    def at_limit(self) -> bool:
        """True if the variable is at one of its limits, up to `NEAR`, or beyond."""
        near = NEAR * (self.scale + abs(self.nearer_limit))
        return math.isfinite(self.distance) and self.distance <= near

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "value": self.value,
            "role": self.role,
            "lowest": self.lowest,
            "highest": self.highest,
            "unit": self.unit,
            "assumed": self.assumed,
            "margin": self.distance,
            "nearer": self.nearer,
            "at_limit": self.at_limit,
        }


def all_margins(
    model: Model, condition: TrimCondition, x: Any, u: Any, undetermined: Sequence[str]
) -> dict[str, Margin]:
    """Return the margins of a trim, name -> `Margin`, for all states, relevant outputs and inputs.

    An output is relevant if the trim or the default trim imposes the output, the model limits it,
    or the output replaces a state.

    condition: condition of the trim
    x: state at the trim, by name
    u: input at the trim, by name
    undetermined: names of free variables that no equation determines
    """
    roles = dict.fromkeys(condition.imposed, "held") | dict.fromkeys(condition.free, "free")
    roles |= dict.fromkeys(undetermined, "left")
    if set(condition.free) <= set(model.inputs):
        # No state is free, so the states that outputs replace are held: pitch = gamma + alpha.
        roles |= dict.fromkeys(model.replaced, "held")
    named = {*model.variables, *model.trim, *condition.imposed}
    outputs = [
        name
        for name, signal in model.outputs.items()
        if name in named or math.isfinite(signal.min) or math.isfinite(signal.max)
    ]
    values = model.outputs_at(x, u, outputs) | x._asdict() | u._asdict()

    named_limits = condition.limits_on((*model.states, *outputs, *model.inputs))
    ends = zip(named_limits.lowest.tolist(), named_limits.highest.tolist(), strict=True)
    limits = dict(zip(named_limits.names, ends, strict=True))
    assumed = dict(zip(named_limits.names, named_limits.assumed.tolist(), strict=True))

    margins = {}
    for name, (lowest, highest) in limits.items():
        signal, role = model.signals[name], roles.get(name, "follows")
        about = (lowest, highest, signal.unit, signal.nominal, assumed[name])
        margins[name] = Margin(name, values[name], role, *about)
    return margins


#: Outputs whose product is the largest lift, of a model that declares them.
_FACTORS_OF_LARGEST_LIFT = ("dynamic_pressure", "reference_area", "largest_lift_coefficient")


def stalled(
    model: Model, states: np.ndarray, inputs: np.ndarray, parameters: np.ndarray
) -> np.ndarray:
    """Return which of N trims are stalled, (N,): the lift L is above q S CL_max, or without a
    declared CL_max, ∂L/∂α < 0.

    A model without the state alpha or the output lift is never stalled.

    states: (N, n); nan without a trim, which is not stalled
    inputs: (N, m)
    parameters: (N, number of parameters)
    """
    alpha = recognized(model.states).get("alpha", "")
    if not alpha or "lift" not in model.outputs:
        return np.zeros(len(states), dtype=bool)
    is_declared = {*_FACTORS_OF_LARGEST_LIFT} <= {*model.outputs}
    symbols = model.layout.symbols("x", "u", "p")
    names = ("lift", *(_FACTORS_OF_LARGEST_LIFT if is_declared else ()))
    _, outputs = model.layout.expressions(symbols, names)
    lift = outputs[0]
    # reserve: negative beyond the stall
    if is_declared:
        reserve = outputs[1] * outputs[2] * outputs[3] - lift
    else:
        reserve = ca.jacobian(lift, symbols[0][model.state_places([alpha])[0]])
    reserve_rows = RowFunction(ca.Function("reserve", symbols, [ca.densify(reserve)]))
    (reserves,) = reserve_rows(states, inputs, parameters)
    return np.asarray(reserves[:, 0] < 0.0)
