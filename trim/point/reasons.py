"""Why a condition has no trim: in turn, the speed, the lift and a moment are released, and what is
to balance them is followed over its range, with all other equations balanced by Newton's method.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from itertools import chain
from typing import NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import AIRSPEEDS, recognized
from hfa_support.errors import BadInputError
from hfa_support.units import STANDARD_GRAVITY, conversion_factor
from trim.point.condition import TrimCondition, release
from trim.point.problem import TrimProblem
from trim.point.solve import TrimError
from trim.point.status import BALANCE

#: Angles of attack, rad, at which the greatest lift is searched.
_ANGLES_OF_ATTACK = np.radians(np.arange(-4.0, 40.5, 0.5))
#: Moment about an axis, by the role of the rate that it changes.
_MOMENTS = {"q": "pitching", "r": "yawing", "p": "rolling"}
#: Imposed value that gives way if the thrust cannot.
_FLIGHT_PATH = "gamma"
#: Halvings of a range in which the thrust jumps, and the largest change of a state there, relative
#: to its nominal value: a larger one leads to another solution.
_HALVINGS = 40
_NEAR = 0.5
#: Least rest of a rate that is reported, in its scale.
_LEAST_REPORTED = 1e-6

#: Values of states, inputs, outputs and rates by name.
Values = Mapping[str, float]


class Reason(NamedTuple):
    """Reason of a failed trim.

    sentence: the reason, "" if it is unknown
    free: imposed value that advice sets free first, or ""
    """

    sentence: str = ""
    free: str = ""


def reason_of(error: TrimError, model: Model, condition: TrimCondition) -> Reason:
    """Return why a condition has no trim.

    The reason is unknown if imposed inputs leave fewer unknowns than equations.

    error: error of the trim search
    condition: condition of the failed trim
    """
    if not model.inputs:
        return Reason("no input changes a force or a moment")
    posed = TrimProblem(model, condition)  # with a speed in place of an airspeed
    equations, unknowns = posed.count
    also_imposed = condition.imposed.keys() - model.trim.keys()  # not by the declared trim
    if equations > unknowns and not also_imposed.isdisjoint(model.inputs):
        return Reason()
    search = _Search(posed, error, condition.imposed)
    reasons = chain(
        search.of_held_inputs(),
        search.of_thrust(),
        search.of_lift(),
        search.of_controls(),
        search.of_rest(),
    )
    return next(reasons, Reason())


class _Search:
    """Search of the reason of a failed trim.

    posed: its problem
    error: its error
    imposed: what the condition imposes, such as an airspeed in place of the speed of `posed`
    """

    def __init__(self, posed: TrimProblem, error: TrimError, imposed: Mapping[str, object]) -> None:
        self.posed, self.error, self.imposed = posed, error, imposed
        self.model, self.condition = posed.model, posed.condition
        self.roles = recognized(self.model.states)
        limits = posed.system.limits
        ends = zip(limits.lowest.tolist(), limits.highest.tolist(), strict=True)
        self.limits = dict(zip(posed.free, ends, strict=True))
        self.throttles = [
            name
            for name in posed.free
            if name in self.model.inputs and re.search("throttle|thrust", name.lower())
        ]

    def solved(self, hold: Values, *dropped: str) -> Values | None:
        """Return the values at which all equations but those of some rates balance, or None.

        hold: further imposed values
        """
        posed = self.posed
        try:
            problem = TrimProblem(posed.model, release(self.condition, free=dropped, hold=hold))
            z = problem.newton(problem.clip(problem.system.start))
            if not problem.solved(z):
                return None
            x, u = problem.at(z)[:2]
        except (BadInputError, ArithmeticError):
            return None
        rates = {f"{name}_dot": rate for name, rate in self.model.rates_at(x, u).items()}
        return {**x._asdict(), **u._asdict(), **self.model.outputs_at(x, u), **rates}

    def rest(self, role: str) -> str:
        """Return the name of the rate of the state of a role if it must balance, else ""."""
        state = self.roles.get(role, "")
        return f"{state}_dot" if state in self.condition.rates else ""

    def throttle(self, share: float) -> dict[str, float]:
        """Return the throttles at a share of their range, all alike."""
        ends = ((name, *self.limits[name]) for name in self.throttles)
        return {name: float(low + share * (high - low)) for name, low, high in ends}

    def of_thrust(self) -> Iterator[Reason]:
        """Yield what is missing at full throttle, too much at idle, or jumps between them."""
        dot = self.rest("speed")
        if not (dot and self.throttles):
            return
        full = self.solved(self.throttle(1.0), dot)
        if full is None:
            return
        least = _LEAST_REPORTED * self.model.rate_scale(self.roles["speed"])
        if full[dot] < -least:
            yield Reason(self._missing(full, dot), _FLIGHT_PATH)
            return
        idle = self.solved(self.throttle(0.0), dot)
        if idle is None:
            return
        if idle[dot] > least:
            sentence = f"at idle the thrust is {self._force(idle, idle[dot])} too large"
            yield Reason(sentence, _FLIGHT_PATH)
        elif full[dot] > least and idle[dot] < -least:
            yield from self._of_jump(idle, full, dot)

    def _missing(self, full: Values, dot: str) -> str:
        """Return a sentence on the thrust that is missing at full throttle."""
        if "thrust" not in full or "weight" not in full:
            rest = self.model.describe(dot, full[dot])
            return f"full throttle is not enough: {dot} is {rest}"
        hp = [value for name, value in full.items() if name[:-1] == "power" and value > 0.0]
        power = f" from {len(hp)} x {hp[0]:.0f} hp" if hp else ""
        missing = self._mass_rate(full, -full[dot])
        unit = self.model.unit("thrust")
        return (
            f"full throttle gives {full['thrust']:.0f} {unit}{power}: {missing:.0f} of "
            f"{full['thrust'] + missing:.0f} {unit} of thrust missing"
        )

    def _mass_rate(self, values: Values, rate: float) -> float:
        """Return the force that changes the speed at a rate."""
        unit = self.model.rate_unit(self.roles["speed"])
        gravity = STANDARD_GRAVITY * (conversion_factor("m/s^2", unit) or 1.0)
        return values["weight"] / gravity * rate

    def _force(self, values: Values, rate: float) -> str:
        """Return a force with its unit, or the rate of the speed without an output weight."""
        if "weight" in values:
            return f"{self._mass_rate(values, rate):.0f} {self.model.unit('weight')}"
        return self.model.describe(self.rest("speed"), rate)

    def _of_jump(self, before: Values, after: Values, dot: str) -> Iterator[Reason]:
        """Yield the jump of the thrust between two points at which the speed falls and rises."""
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            values = self.solved(self.throttle(share), dot)
            if values is None:
                return
            if values[dot] < 0.0:
                low, before = share, values
            else:
                high, after = share, values
        moves = [
            abs(after[name] - before[name]) / state.nominal
            for name, state in self.model.states.items()
        ]
        if max(moves) > _NEAR or after[dot] - before[dot] < 1e-3 * self.model.rate_scale(
            self.roles["speed"]
        ):
            return  # another solution, or none of the throttles jumps
        describe, throttle = self.model.describe, self.throttles[0]
        changes = ", ".join(
            f"{name} from {describe(name, before[name])} to {describe(name, after[name])}"
            for name in ("thrust", dot)
            if name in before
        )
        at = describe(throttle, before[throttle])
        sentence = f"no throttle balances the drag: at {throttle} {at} the thrust jumps ({changes})"
        yield Reason(sentence, _FLIGHT_PATH)

    def of_lift(self) -> Iterator[Reason]:
        """Yield the greatest lift at an imposed airspeed if it is too small."""
        speed, drag, lift = self.roles.get("speed", ""), self.rest("speed"), self.rest("alpha")
        if not ({speed, *AIRSPEEDS} & {*self.imposed} and drag and lift):
            return
        needed = float(self.condition.imposed.get("load_factor", 1.0))  # of a pull-up
        dropped = [lift, drag, *{"load_factor"} & {*self.condition.imposed}]
        balanced = self._greatest_lift(*dropped)
        if balanced is None or balanced[0] >= needed:
            return
        # Without balance of the pitching moment, the lift may be enough.
        any_moment = self._greatest_lift(*dropped, self.rest("q")) if self.rest("q") else None
        share, alpha = max(balanced, any_moment or balanced)
        what = "the greatest lift is"
        if share >= needed:
            share, alpha = balanced
            controls = " and ".join(self._effects(self.roles["q"]))
            what = f"{controls} balance the pitching moment only up to a lift of"
        sentence = f"{what} {100.0 * share:.0f} % of the weight, at alpha {alpha:.1f} deg"
        if needed != 1.0:
            sentence += f"; {100.0 * needed:.0f} % is needed"
        free = next(name for name in self.imposed if name in (speed, *AIRSPEEDS))
        yield Reason(sentence, free)

    def _greatest_lift(self, *dropped: str) -> tuple[float, float] | None:
        """Return the greatest lift / weight over alpha at half throttle, and this alpha, deg."""
        alpha = self.roles["alpha"]
        unit = conversion_factor("rad", self.model.unit(alpha)) or 1.0
        found = []
        for angle in _ANGLES_OF_ATTACK.tolist():
            values = self.solved({alpha: angle * unit, **self.throttle(0.5)}, *dropped)
            if values is not None and "weight" in values and "lift" in values:
                ratio = values.get("lift_to_weight", values["lift"] / values["weight"])
                found.append((ratio, math.degrees(angle)))
        return max(found, default=None)

    def of_controls(self) -> Iterator[Reason]:
        """Yield the moment that is not balanced with its control at either end of its range."""
        for role, moment in _MOMENTS.items():
            dot = self.rest(role)
            control = self._control(self.roles.get(role, ""))
            if not (dot and control):
                continue
            least = _LEAST_REPORTED * self.model.rate_scale(self.roles[role])
            for also in ((), (self.rest("speed"),)):
                solved = (self.solved({control: end}, dot, *also) for end in self.limits[control])
                ends = [values for values in solved if values is not None]
                if len(ends) < 2:
                    continue
                nearest = min(ends, key=lambda values: abs(values[dot]))
                if ends[0][dot] * ends[1][dot] > 0.0 and abs(nearest[dot]) > least:
                    rest = self.model.describe(dot, nearest[dot])
                    at = self.model.describe(control, nearest[control])
                    yield Reason(
                        f"the {moment} moment is not balanced with {control} at either end of its "
                        f"range: {rest} remain at {at}"
                    )
                break

    def _control(self, state: str) -> str:
        """Return the free input that changes the rate of a state most over its range, or ""."""
        effects = {name: size for name, size in self._effects(state).items() if size < math.inf}
        return max(effects, key=effects.__getitem__, default="")

    def _effects(self, state: str) -> dict[str, float]:
        """Return the free inputs that change the rate of a state, with the change over the range
        of the input.
        """
        rows = [row.name for row in self.posed.system.equations.rows]
        if state not in rows:
            return {}
        point = self.posed.clip(self.posed.system.scaled(self.error.attempt.values))
        slopes = self.posed.at(point).jacobian[rows.index(state)] / self.posed.system.scales
        return {
            name: abs(slope) * (self.limits[name][1] - self.limits[name][0])
            for name, slope in zip(self.posed.free, slopes.tolist(), strict=True)
            if slope and name in self.model.inputs and name not in self.throttles
        }

    def of_held_inputs(self) -> Iterator[Reason]:
        """Yield the unbalanced rotation that only inputs change that the condition imposes."""
        for state, moved_by in self.error.attempt._unbalanced_rotations:
            if moved_by and {*moved_by} <= {*self.imposed}:
                yield Reason(f"no free input changes {state}", moved_by[0])

    def of_rest(self) -> Iterator[Reason]:
        """Yield the rate without which all others balance, if the unknowns are fewer."""
        equations, unknowns = self.posed.count
        if equations <= unknowns:
            return
        residuals = self.error.attempt.scaled_residuals
        for name in sorted(residuals, key=lambda each: -abs(residuals[each])):
            is_left = name in self.condition.rates and abs(residuals[name]) > BALANCE
            if is_left and (values := self.solved({}, f"{name}_dot")):
                rest = self.model.describe(f"{name}_dot", values[f"{name}_dot"])
                free = _FLIGHT_PATH if name == self.roles.get("speed") else ""
                yield Reason(f"all balances but {name}, which changes by {rest}", free)
