"""Why a condition has no trim: in turn, the speed, the lift and a moment are released, and what is
to balance them is followed over its range, with all other equations balanced by Newton's method.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import chain, product
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
from trim.point.solve import TrimError
from trim.point.status import BALANCE

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


def reason_of(error: TrimError, model: Model, condition: TrimCondition) -> str:
    """Return why a condition has no trim, or "" if the reason is unknown.

    error: error of the trim search
    condition: condition of the failed trim
    """
    posed = TrimProblem(model, condition)  # with a speed in place of an airspeed
    search = _Search(posed, error.attempt)
    reasons = (search.of_thrust, search.of_lift, search.of_controls, search.of_rest)
    return next(chain.from_iterable(reason() for reason in reasons), "")


class _Balance(NamedTuple):
    """Point at which all equations but the released ones balance.

    values: state, input or output -> value
    rests: equation -> what remains of it, in its unit
    """

    values: Mapping[str, float]
    rests: Mapping[str, float]


class _Search:
    """Search of the reason of a failed trim.

    posed: its problem
    attempt: its best point
    """

    def __init__(self, posed: TrimProblem, attempt: OperatingPoint):
        self.posed, self.attempt = posed, attempt
        self.model, self.system = posed.model, posed.system
        self.rows = {row.name: row for row in self.system.equations.rows}
        roles = recognized(self.model.states)
        #: Role -> state whose rate must balance.
        self.balanced = {role: name for role, name in roles.items() if name in self.rows}
        limits = self.system.limits
        ends = zip(limits.lowest.tolist(), limits.highest.tolist(), strict=True)
        self.limits = dict(zip(posed.free, ends, strict=True))
        inputs = [name for name in posed.free if name in self.model.inputs]
        self.throttles = [name for name in inputs if re.search("throttle|thrust", name.lower())]
        self.controls = [name for name in inputs if name not in self.throttles]

    def released(self, held: Mapping[str, float], *names: str) -> _Balance | None:
        """Return the point at which all equations but those of some names balance, or None.

        held: unknowns that keep a value
        """
        posed, system = self.posed, self.system
        moving = [place for place, name in enumerate(posed.free) if name not in held]
        rows = [place for place, name in enumerate(self.rows) if name not in names]
        z = posed.clip(system.scaled({**system.begin, **held}))
        try:
            z = posed.newton(z, np.array(moving), [row for row in rows if row < posed.count[0]])
            at = posed.at(z)
        except (BadInputError, ArithmeticError):
            return None
        is_within = system.limits.within(z * system.scales).all()
        is_within = is_within and system.watched.within(at.y).all()
        if not is_within or np.abs(at.residual[rows]).max(initial=0.0) > BALANCE:
            return None
        residuals = zip(self.rows.values(), at.residual.tolist(), strict=True)
        return _Balance(
            {**at.x._asdict(), **at.u._asdict(), **self.model.outputs_at(at.x, at.u)},
            {row.name: residual * row.scale for row, residual in residuals},
        )

    def throttle(self, share: float) -> dict[str, float]:
        """Return the throttles at a share of their range, all alike."""
        ends = ((name, *self.limits[name]) for name in self.throttles)
        return {name: low + share * (high - low) for name, low, high in ends}

    def of_thrust(self) -> Iterator[str]:
        """Yield what is missing at full throttle, too much at idle, or jumps between them."""
        speed = self.balanced.get("speed", "")
        if not (speed and self.throttles):
            return
        ends = []
        for share, end, what in ((1.0, "full throttle", "small"), (0.0, "idle", "large")):
            at = self.released(self.throttle(share), speed)
            if at is None:
                return
            excess = at.rests[speed] if share == 0.0 else -at.rests[speed]
            if excess > _LEAST_REPORTED * self.rows[speed].scale:
                given = self._thrust(at)
                yield f"at {end} the thrust is {self._force(at, speed)} too {what}{given}"
                return
            ends.append(at)
        yield from self._of_jump(ends[1], ends[0], speed)

    def _thrust(self, at: _Balance) -> str:
        """Return the thrust and the power in brackets, "" without an output thrust."""
        if "thrust" not in at.values:
            return ""
        powers = (power for name, power in at.values.items() if name[:-1] == "power")
        hp = [power for power in powers if power > 0.0]
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

    def _of_jump(self, before: _Balance, after: _Balance, speed: str) -> Iterator[str]:
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
        yield (
            f"no throttle balances the drag: at {throttle} {at} the thrust jumps from {jump}"
            f"{self._thrust(before)}"
        )

    def of_lift(self) -> Iterator[str]:
        """Yield the greatest lift at an imposed airspeed if it is too small at all angles."""
        alpha, speed = self.balanced.get("alpha"), self.balanced.get("speed")
        if not (alpha and speed) or {speed, *AIRSPEEDS}.isdisjoint(self.posed.condition.imposed):
            return
        if alpha not in self.limits:
            freed = TrimProblem(self.model, release(self.posed.condition, free=[alpha]))
            yield from _Search(freed, self.attempt).of_lift()
            return
        unit = conversion_factor("deg", self.model.unit(alpha)) or 1.0
        tried: dict[float, list[_Balance]] = {}
        shares = (0.5, 0.0, 1.0) if self.throttles else (0.0,)
        for angle, share in product((_ANGLES_OF_ATTACK * unit).tolist(), shares):
            held = {alpha: angle, **self.throttle(share)}
            if at := self.released(held, alpha, speed, "load_factor"):
                tried.setdefault(share, []).append(at)
                if self._lack(at) <= 0.0:
                    return
        if len(tried) < len(shares):
            return
        values = max(
            chain(*tried.values()), key=lambda at: at.values.get("lift", -self._lack(at))
        ).values
        size = "too small"
        if {"lift", "weight"} <= values.keys():
            share = values.get("lift_to_weight", values["lift"] / values["weight"])
            size = f"{100.0 * share:.0f} % of the weight"
        at_alpha = f"at {alpha} {self.model.describe(alpha, values[alpha])}"
        needed = self.posed.condition.imposed.get("load_factor", 1.0)
        more = f"; {100.0 * needed:.0f} % is needed" if needed != 1.0 else ""
        yield f"with balanced moments the greatest lift is {size}, {at_alpha}{more}"

    def _lack(self, at: _Balance) -> float:
        """Return a measure of the lift that is missing, which increases alpha."""
        of_load = -at.rests.get("load_factor", 0.0)  # of a pull-up
        return of_load if "load_factor" in self.rows else at.rests[self.balanced["alpha"]]

    def controls_of(self, state: str) -> list[str]:
        """Return the free controls that change the rate of a state where the search begins, and
        have limits, the strongest first.
        """
        begin = self.posed.clip(self.system.start)
        slopes = self.posed.at(begin).jacobian[[*self.rows].index(state)] / self.system.scales
        slope_of = dict(zip(self.posed.free, np.abs(slopes).tolist(), strict=True))
        limited = (name for name in self.controls if np.isfinite(self.limits[name]).all())
        moving = [name for name in limited if slope_of[name]]
        return sorted(moving, key=slope_of.__getitem__, reverse=True)

    def of_controls(self) -> Iterator[str]:
        """Yield the moment that is not balanced with its controls at either end of their range."""
        speed = self.balanced.get("speed", "")
        for role, moment in _MOMENTS.items():
            state = self.balanced.get(role, "")
            if not state:
                continue
            inputs = [at for at, name in enumerate(self.posed.free) if name in self.model.inputs]
            effects = self.system.equations.jacobian[[*self.rows].index(state), inputs]
            is_moved = ca.sparsify(effects).nnz() > 0
            if not is_moved and abs(self.attempt.scaled_residuals[state]) > BALANCE:
                yield f"no free input changes {state}"
            # each control at both ends, with or without balance of the speed
            for name, also in product(self.controls_of(state), ("", speed)):
                low, high = (self.released({name: end}, state, also) for end in self.limits[name])
                if low is None or high is None:
                    continue
                nearest = min((low, high), key=lambda at: abs(at.rests[state]))
                least = _LEAST_REPORTED * self.rows[state].scale
                if low.rests[state] * high.rests[state] > 0.0 and abs(nearest.rests[state]) > least:
                    rest = self.model.describe(f"{state}_dot", nearest.rests[state])
                    at = self.model.describe(name, nearest.values[name])
                    yield (
                        f"the {moment} moment is not balanced at either end of {name}: "
                        f"{rest} remain at {at}"
                    )

    def of_rest(self) -> Iterator[str]:
        """Yield the rate without which all others balance, if the unknowns are fewer."""
        equations, unknowns = self.posed.count
        residuals = self.attempt.scaled_residuals if equations > unknowns else {}
        for name in sorted(residuals, key=lambda each: -abs(residuals[each])):
            is_left = self.rows[name].is_rate and abs(residuals[name]) > BALANCE
            if is_left and (at := self.released({}, name)):
                rest = self.model.describe(f"{name}_dot", at.rests[name])
                yield f"all balances but {name}, which changes by {rest}"
