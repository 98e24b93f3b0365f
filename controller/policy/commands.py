"""Step sequences of commanded outputs through a second-order filter: what a servo is to follow."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_model.vectors import LINEAR_STATES, Quantity
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.reporting.fields import Shown

#: Bandwidth, rad/s, and damping of the command filter unless said: those of SimVFA (Thomsen 2018).
COMMAND_FILTER = (0.5, 2.0)


@dataclass(frozen=True, eq=False, repr=False)
class CommandSteps(Shown):
    """r'' = ω² (r_step(t) - r) - 2 ζ ω r' from rest, so that r(t) = Σ_i (R_i - R_i-1) s(t - t_i), R_-1 = 0.

    s: the step response of the filter. names: outputs, as deviations from trim. times: t_i (S,), s, increasing,
    from 0 on. values: R (S, k), in the outputs' units. bandwidth ω, rad/s; damping ζ. BadInputError when a number or
    a shape is wrong, or a name is given twice.
    """

    names: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray
    bandwidth: float = COMMAND_FILTER[0]
    damping: float = COMMAND_FILTER[1]

    def __post_init__(self) -> None:
        """Check once."""
        if np.shape(self.values) != (len(self.times), len(self.names)) or not np.all(np.isfinite(self.values)):
            raise BadInputError(
                f"the commands have values of shape {np.shape(self.values)}; give {len(self.times)} finite rows of"
                f" {len(self.names)}"
            )
        for name in self.names:
            if self.names.count(name) > 1:
                raise BadInputError(f"the command of {name} is given twice; give it once")
        if len(self.times) and not (self.times[0] >= 0.0 and np.all(np.diff(self.times) > 0.0)):
            raise BadInputError("the times of the commands must increase, from 0 on")
        for name in ("bandwidth", "damping"):
            refuse_unless_positive(f"the {name} of the command filter", getattr(self, name))

    def at(self, t: Quantity) -> ca.SX:
        """r(t), (k,), at a CasADi expression."""
        return self._summed(t, self._response)

    def rate(self, t: Quantity) -> ca.SX:
        """r'(t), (k,)."""
        return self._summed(t, self._response_rate)

    def end(self, t: Quantity) -> ca.SX:
        """r_step(t), (k,): what the filter is on its way to."""
        return self._summed(t, lambda late: late >= 0.0)

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """r at many times, (N, k)."""
        t = ca.SX.sym("t")
        function = ca.Function("commands", [t], [self.at(t)]).map(len(times))
        return np.array(function(times[None])).T.reshape(len(times), len(self.names))

    def _summed(self, t: Quantity, response: Callable[[Quantity], Quantity]) -> ca.SX:
        """Σ_i (R_i - R_i-1) response(t - t_i), (k,); the response to a step that is still to come is 0."""
        total = ca.SX.zeros(len(self.names))
        jumps = np.diff(self.values, axis=0, prepend=np.zeros((1, len(self.names))))
        for begin, jump in zip(self.times.tolist(), jumps, strict=True):
            total = total + ca.DM(jump) * response(t - begin)
        return total

    def _response(self, late: Quantity) -> Quantity:
        w, z, tau = self.bandwidth, self.damping, ca.fmax(late, 0.0)
        if z == 1.0:
            return 1 - (1 + w * tau) * ca.exp(-w * tau)
        if z < 1.0:
            v = w * math.sqrt(1 - z**2)
            return 1 - ca.exp(-z * w * tau) * (ca.cos(v * tau) + z * w / v * ca.sin(v * tau))
        slow, fast = self._poles
        return 1 - (fast * ca.exp(-slow * tau) - slow * ca.exp(-fast * tau)) / (fast - slow)

    def _response_rate(self, late: Quantity) -> Quantity:
        w, z, tau = self.bandwidth, self.damping, ca.fmax(late, 0.0)
        if z == 1.0:
            return w**2 * tau * ca.exp(-w * tau)
        if z < 1.0:
            v = w * math.sqrt(1 - z**2)
            return w**2 / v * ca.exp(-z * w * tau) * ca.sin(v * tau)
        slow, fast = self._poles
        return slow * fast / (fast - slow) * (ca.exp(-slow * tau) - ca.exp(-fast * tau))

    @property
    def _poles(self) -> tuple[float, float]:
        spread = math.sqrt(self.damping**2 - 1)
        return self.bandwidth * (self.damping - spread), self.bandwidth * (self.damping + spread)


@dataclass(frozen=True, eq=False)
class CommandedStates:
    """x_d(t), (6,): the commands of states of the linear model, 0 for the others; the reference of a flight."""

    size = len(LINEAR_STATES)

    commands: CommandSteps

    def to_dict(self) -> dict[str, Any]:
        """The steps as data for JSON."""
        return asdict(self.commands)

    def at(self, t: Quantity) -> ca.SX:
        """x_d(t)."""
        names = self.commands.names
        chosen = np.array([[float(name == state) for name in names] for state in LINEAR_STATES])
        return ca.mtimes(ca.DM(chosen.reshape(len(LINEAR_STATES), len(names))), self.commands.at(t))
