"""Why a condition has no trim: in turn, the speed, a moment and the lift are released, and what is
to balance them is followed over its range, with all other equations balanced by Newton's method.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import chain
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import AIRSPEEDS, recognized
from hfa_support.errors import BadInputError
from hfa_support.units import STANDARD_GRAVITY, conversion_factor
from trim.point.condition import TrimCondition, release
from trim.point.operating_point import OperatingPoint
from trim.point.problem import TrimProblem
from trim.point.solve import TrimError, failure
from trim.point.status import BALANCE, Status

#: Angles of attack, deg, at which the greatest lift is searched.
_ANGLES_OF_ATTACK = np.arange(-4.0, 40.5, 0.5)
#: Moment about an axis, by the role of the rate that it changes.
_MOMENTS = {"q": "pitching", "r": "yawing", "p": "rolling"}
#: Halvings of a range in which the thrust jumps, and the largest change of a state there, relative
#: to its nominal value: a larger one leads to another solution.
_HALVINGS = 40
_NEAR = 0.5
#: Least rest of a rate that is reported, in its scale.
_LEAST_REPORTED = 1e-6


def explained(error: TrimError, model: Model, condition: TrimCondition) -> TrimError:
    """Return the error of a failed trim with the reason why the condition has none, if it is known.

    Where the equations do not balance beyond limits either, the point is then that of the reason.

    error: error of the trim search
    condition: condition of the failed trim
    """
    posed = TrimProblem(model, condition)  # with a speed in place of an airspeed
    search = _Search(posed, error.attempt)
    reasons = (search.of_thrust, search.of_controls, search.of_lift, search.of_rest)
    for text, at, saturated in chain.from_iterable(reason() for reason in reasons):
        if at and not error.required:
            attempt = OperatingPoint._of(posed, at.z, Status.FAILED)
            error = TrimError(failure(posed, at.z), attempt)
        details = str(error).removeprefix("no trim: ")
        return TrimError(f"no trim: {text} ({details})", error.attempt, error.required, saturated)
    return error


class _Balance(NamedTuple):
    """Point at which all equations but the released ones balance.

    z: scaled unknowns
    values: state, input or output -> value
    rests: equation -> what remains of it, in its unit
    """

    z: np.ndarray
    values: Mapping[str, float]
    rests: Mapping[str, float]


class _Reason(NamedTuple):
    """Reason, with the point that shows it, and the inputs at the limit that prevents the trim."""

    text: str
    at: _Balance | None = None
    saturated: Mapping[str, float] = {}


class _Search:
    """Search of the reason of a failed trim.

    posed: its problem
    attempt: its best point
    """

    def __init__(self, posed: TrimProblem, attempt: OperatingPoint):
        self.posed, self.attempt = posed, attempt
        self.model = posed.model
        self.rows = {row.name: row for row in posed.system.equations.rows}
        roles = recognized(self.model.states)
        #: Role -> state whose rate must balance.
        self.balanced = {role: name for role, name in roles.items() if name in self.rows}
        self.limits = {name: posed.condition.limits_of(name) for name in posed.free}
        inputs = [name for name in posed.free if name in self.model.inputs]
        self.throttles = [name for name in inputs if re.search("throttle|thrust", name.lower())]
        self.controls = [name for name in inputs if name not in self.throttles]

    def released(self, held: Mapping[str, float], *names: str) -> _Balance | None:
        """Return the point at which all equations but those of some names balance, or None.

        held: unknowns that keep a value
        """
        posed, system = self.posed, self.posed.system
        moving = [place for place, name in enumerate(posed.free) if name not in held]
        rows = [place for place, name in enumerate(self.rows) if name not in names]
        solved = [row for row in rows if row < posed.count[0]]
        for known in ({}, self.attempt.values):
            begin = posed.clip(system.scaled({**system.begin, **known, **held}))
            with suppress(BadInputError, ArithmeticError):
                z = posed.newton(begin, np.array(moving), solved, bounded=True)
                at = posed.at(z)
                if np.abs(at.residual[rows]).max(initial=0.0) > BALANCE or not posed.within(z):
                    continue
                residuals = zip(self.rows.values(), at.residual.tolist(), strict=True)
                return _Balance(
                    z,
                    {**at.x._asdict(), **at.u._asdict(), **self.model.outputs_at(at.x, at.u)},
                    {row.name: residual * row.scale for row, residual in residuals},
                )
        return None

    def throttle(self, share: float) -> dict[str, float]:
        """Return the throttles at a share of their range, all alike."""
        ends = ((name, *self.limits[name]) for name in self.throttles)
        return {name: low + share * (high - low) for name, low, high in ends}

    def of_thrust(self) -> Iterator[_Reason]:
        """Yield what is missing at full throttle, too much at idle, or jumps between them."""
        speed = self.balanced.get("speed", "")
        if not (speed and self.throttles):
            return
        ends = []
        sides = ((1.0, -1.0, "full throttle", "small"), (0.0, 1.0, "idle", "large"))
        for share, sign, end, what in sides:
            held = self.throttle(share)
            at = self.released(held, speed)
            if at is None:
                return
            if sign * at.rests[speed] > _LEAST_REPORTED * self.rows[speed].scale:
                size = f"{self._force(at, speed)} too {what}{self._thrust(at)}"
                throttle = self.throttles[0]
                if throttle in self.posed.condition.limits:
                    end = f"{throttle} {self.model.describe(throttle, held[throttle])}"
                yield _Reason(f"at {end} the thrust is {size}", at, held)
                return
            ends.append(at)
        yield from self._of_jump(ends[1], ends[0], speed)

    def _thrust(self, at: _Balance) -> str:
        """Return the thrust and the power in brackets, "" without an output thrust."""
        if "thrust" not in at.values:
            return ""
        hp = [hp for name, hp in at.values.items() if name[:-1] == "power" and hp > 0.0]
        of = f" from {len(hp)} x {hp[0]:.0f} hp" if hp else ""
        return f" ({at.values['thrust']:.0f} {self.model.unit('thrust')}{of})"

    def _force(self, at: _Balance, speed: str) -> str:
        """Return the force that is missing or too large, or without an output weight the rate."""
        rate = abs(at.rests[speed])
        if "weight" not in at.values:
            return self.model.describe(f"{speed}_dot", rate)
        gravity = conversion_factor("m/s^2", self.model.rate_unit(speed)) or 1.0
        force = at.values["weight"] / (STANDARD_GRAVITY * gravity) * rate
        return f"{force:.0f} {self.model.unit('weight')}"

    def _of_jump(self, before: _Balance, after: _Balance, speed: str) -> Iterator[_Reason]:
        """Yield the jump of the thrust between two points at which the speed falls and rises."""
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            share = 0.5 * (low + high)
            middle = self.released(self.throttle(share), speed)
            if middle is None:
                return
            if middle.rests[speed] < 0.0:
                low, before = share, middle
            else:
                high, after = share, middle
        moves = [
            abs(after.values[name] - before.values[name]) / state.nominal
            for name, state in self.model.states.items()
        ]
        size = after.rests[speed] - before.rests[speed]
        if max(moves) > _NEAR or size < 1e-3 * self.rows[speed].scale:
            return  # another solution, or none of the throttles jumps
        throttle = self.throttles[0]
        at = self.model.describe(throttle, before.values[throttle])
        jump = f"{self._force(before, speed)} too small to {self._force(after, speed)} too large"
        yield _Reason(
            f"no throttle balances the drag: at {throttle} {at} the thrust jumps from {jump}"
            f"{self._thrust(before)}",
            before,
        )

    def of_lift(self) -> Iterator[_Reason]:
        """Yield the greatest lift at an imposed airspeed if it is too small at all angles."""
        alpha, speed = self.balanced.get("alpha"), self.balanced.get("speed")
        if not (alpha and speed) or {speed, *AIRSPEEDS}.isdisjoint(self.posed.condition.imposed):
            return
        if alpha not in self.limits:
            freed = TrimProblem(self.model, release(self.posed.condition, free=[alpha]))
            yield from _Search(freed, self.attempt).of_lift()
            return
        unit = conversion_factor("deg", self.model.unit(alpha)) or 1.0
        tried: list[_Balance] = []
        for share in (0.5, 0.0, 1.0) if self.throttles else (0.0,):
            held = ({alpha: angle, **self.throttle(share)} for angle in _ANGLES_OF_ATTACK * unit)
            found = [self.released(each, alpha, speed, "load_factor") for each in held]
            balances = [at for at in found if at]
            if not balances or min(map(self._lack, balances)) <= 0.0:
                return
            tried += balances
        best = max(tried, key=lambda at: at.values.get("lift", -self._lack(at)))
        values, size = best.values, "too small"
        if {"lift", "weight"} <= values.keys():
            size = f"{100.0 * values['lift'] / values['weight']:.0f} % of the weight"
        at_alpha = f"at {alpha} {self.model.describe(alpha, values[alpha])}"
        needed = self.posed.condition.imposed.get("load_factor", 1.0 / np.cos(self.bank(best)))
        more = f"; {100.0 * needed:.0f} % is needed" if abs(needed - 1.0) > 1e-3 else ""
        yield _Reason(f"with balanced moments the greatest lift is {size}, {at_alpha}{more}", best)

    def bank(self, at: _Balance) -> float:
        """Return the angle of bank in rad, 0 for a model without one."""
        name = recognized(self.model.states).get("phi", "")
        factor = conversion_factor(self.model.unit(name), "rad") if name else None
        return at.values[name] * factor if factor else 0.0

    def _lack(self, at: _Balance) -> float:
        """Return a measure of the lift that is missing, which increases alpha."""
        of_load = -at.rests.get("load_factor", 0.0)  # of a pull-up
        return of_load if "load_factor" in self.rows else at.rests[self.balanced["alpha"]]

    def of_controls(self) -> Iterator[_Reason]:
        """Yield the moment that is not balanced at either end of the range of its control, the one
        with the largest effect where the search begins.
        """
        posed, jacobian = self.posed, self.posed.system.equations.jacobian
        begin = posed.at(posed.clip(posed.system.start)).jacobian / posed.system.scales
        for role, moment in _MOMENTS.items():
            state = self.balanced.get(role, "")
            if not state:
                continue
            row, least = [*self.rows].index(state), _LEAST_REPORTED * self.rows[state].scale
            inputs = [at for at, name in enumerate(posed.free) if name in self.model.inputs]
            # An equation that no unknown affects has no row in the Jacobian.
            if row >= posed.count[0] or not ca.sparsify(jacobian[row, inputs]).nnz():
                if abs(self.attempt.scaled_residuals[state]) > _LEAST_REPORTED:
                    yield _Reason(f"no free input changes {state}")
                continue
            slope_of = dict(zip(posed.free, np.abs(begin[row]).tolist(), strict=True))
            name = max(self.controls, key=slope_of.__getitem__, default="")
            if not (name and slope_of[name] and np.isfinite(self.limits[name]).all()):
                continue
            for also in ("", self.balanced.get("speed", "")):  # with or without balanced speed
                ends = [self.released({name: end}, state, also) for end in self.limits[name]]
                low, high = (at.rests[state] if at else 0.0 for at in ends)
                nearest = ends[abs(high) < abs(low)]
                if nearest and low * high > 0.0 and min(abs(low), abs(high)) > least:
                    rest = self.model.describe(f"{state}_dot", nearest.rests[state])
                    at = self.model.describe(name, nearest.values[name])
                    yield _Reason(
                        f"the {moment} moment is not balanced at either end of {name}: "
                        f"{rest} remain at {at}",
                        nearest,
                        {name: nearest.values[name]},
                    )

    def of_rest(self) -> Iterator[_Reason]:
        """Yield the rate without which all others balance, if the unknowns are fewer."""
        equations, unknowns = self.posed.count
        residuals = self.attempt.scaled_residuals if equations > unknowns else {}
        for name in sorted(residuals, key=lambda each: -abs(residuals[each])):
            is_left = self.rows[name].is_rate and abs(residuals[name]) > BALANCE
            if is_left and (at := self.released({}, name)):
                rest = self.model.describe(f"{name}_dot", at.rests[name])
                yield _Reason(f"all balances but {name}, which changes by {rest}", at)
