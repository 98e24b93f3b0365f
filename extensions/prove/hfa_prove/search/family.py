"""Trims of an aircraft at any value of its scheduling variable, and gains there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.linear_game import game
from controller.riccati.gare import solve
from hfa_aircraft.model import Model
from hfa_prove.check.trims import SteadyFlight
from hfa_prove.statements.flight import Flight, in_model_unit, unknowns_of
from hfa_prove.statements.schedule import Gains
from hfa_support.errors import BadInputError
from hfa_support.matrices import LinearTable
from trim.linear.linearize import linearize
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim

#: Limits beyond this value are treated as infinite.
_FAR = 1e300
#: Largest distance between two breakpoints of exact gains: of an angle, deg, and of any other
#: variable, in nominal values.
_STEP_DEG = 2.0
_STEP_NOMINAL = math.radians(_STEP_DEG)


@dataclass(frozen=True)
class Family:
    """Trims of an aircraft at any value of its scheduling variable.

    model: the aircraft with its declared parameter values
    flights: trim condition, or None for the condition of the model's trim
    """

    model: Model
    flights: TrimCondition | None = None

    def condition(self, scheduling_value: float | None = None) -> TrimCondition:
        """Return the trim condition at a scheduling value, by default at the model's own value."""
        flights = usual_condition(self.model) if self.flights is None else self.flights
        if scheduling_value is None or self.model.schedule in self.model.parameters:
            return flights.at(None)
        return flights.at(in_model_unit(self.model, scheduling_value))

    def point(self, scheduling_value: float) -> OperatingPoint:
        """Return the trim at a scheduling value, in double precision.

        Raises TrimError if there is no trim.
        """
        model = self.model
        if model.schedule in model.parameters:
            value = in_model_unit(model, scheduling_value)
            model = model.with_parameters(**{model.schedule: value})
        return trim(model, self.condition(scheduling_value))

    def flight(self, low: float, high: float) -> Flight:
        """Return the trims from `low` to `high` in the form of a statement.

        Raises BadInputError if a limit is wider than the model's. Raises TrimError if there is no
        trim at `low`.
        """
        model = self.model
        condition = self.condition()
        imposed = dict(condition.imposed)
        imposed.pop(model.schedule, None)
        limits = {}
        for name, (least, most) in model.limits.items():
            lowest, highest = condition.limits_of(name)
            if name in model.airspeeds:  # a function of signals that have limits
                if (lowest, highest) != (least, most):
                    raise BadInputError(f"a limit of {name} cannot be proved; limit the speed")
                continue
            if lowest < least or highest > most:
                raise BadInputError(
                    f"the limits of {name} are wider than the model's, "
                    f"{model.describe(name, least)} to "
                    f"{model.describe(name, most)}; narrow these limits"
                )
            if np.isfinite((lowest, highest)).any() and name not in model.disturbances:
                limits[name] = (max(lowest, -_FAR), min(highest, _FAR))
        parameters = {name: signal.start for name, signal in model.parameters.items()}
        values = self.point(low).values
        first = {name: float(values[name]) for name in unknowns_of(model, imposed)}
        return Flight(model, parameters, imposed, limits, (low, high), first)

    def check(self, low: float, high: float) -> None:
        """Raise BadInputError unless proofs support the trims from `low` to `high`.

        The conditions are:
        - The model has a scheduling variable, and low < high.
        - No imposed value depends on the scheduling variable.
        - All rates of the trim are 0, and the scheduling variable is not free.
        - As many equations depend on the free variables as there are free variables.
        """
        model = self.model
        if not model.schedule:
            raise BadInputError(
                f"{model.title} has no scheduling variable, which a proof requires; set "
                "`schedule` in the model"
            )
        if not low < high:
            raise BadInputError(
                f"the interval is {low:g} to {high:g}; give two different ends, the lower first"
            )
        if self.flights is not None:
            for name, value in self.flights.imposed.items():
                if isinstance(value, LinearTable):
                    raise BadInputError(
                        f"{name} depends on the {model.schedule} in this flight condition; give "
                        f"one value with --hold {name}=VALUE"
                    )
        first = self.condition(low)
        self.condition(high)
        if first.rates != dict.fromkeys(model.steady, 0.0) or model.schedule in first.free:
            raise BadInputError(
                f"a proof requires trims at a given {model.schedule} with all rates 0; change "
                "--hold and --free"
            )
        SteadyFlight(self.flight(low, high))


def breakpoints_of(family: Family, low: float, high: float) -> np.ndarray:
    """Return the breakpoints of exact gains from `low` to `high`, equally spaced.

    Their distance is at most `_STEP_DEG` for an angle in deg, and `_STEP_NOMINAL` nominal values
    for any other scheduling variable.
    """
    model = family.model
    if model.schedule_unit == "deg":
        longest = _STEP_DEG
    else:
        longest = _STEP_NOMINAL * model.signals[model.schedule].nominal
    count = max(2, math.ceil((high - low) / longest) + 1)
    return np.linspace(low, high, count)


def exact_gains(family: Family, breakpoints: np.ndarray, **changes: Any) -> Gains:
    """Return the gains of the exact game at scheduling values (g,).

    changes: weights that differ from the default game, name -> value

    Raises NoSolutionError if a breakpoint has no trim or the game there has no solution.
    """
    gains = []
    for breakpoint in breakpoints.tolist():
        point = family.point(breakpoint)
        linear = linearize(point.model, point)
        gains.append(np.asarray(solve(game(linear, **changes)).K, dtype=float))
    return Gains(breakpoints, np.array(gains))
