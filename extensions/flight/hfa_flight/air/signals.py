"""Vector functions of time: filtered commands."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Reported

#: Bandwidth, rad/s, and damping of the command filter, those of SimVFA (Thomsen 2018).
BANDWIDTH, DAMPING = 0.5, 2.0
#: Interface of a reference, disturbance or noise: `size` n, and `at(t)`, the value (n,) at an
#: expression t. `until` is the time, s, at which the signal becomes constant; inf if it is missing.
TimeVector = Any


@dataclass(frozen=True, eq=False, repr=False)
class CommandSteps(Reported):
    """Filtered command steps: r'' = ω² (r_step(t) - r) - 2 ζ ω r', with r = r' = 0 initially.

    ω = 0.5 rad/s and ζ = 2.

    r(t) = Σ_i (R_i - R_i-1) s(t - t_i), R_-1 = 0, where s(t) is the step response of the filter.

    names: commanded outputs
    times: t_i, (S,), s, increasing and at least 0
    values: R, (S, k), deviations from trim in the units of the outputs

    Raises BadInputError if a number or a shape is wrong, or a name occurs twice.
    """

    names: tuple[str, ...]
    times: np.ndarray
    values: np.ndarray

    def __post_init__(self) -> None:
        """Raise BadInputError if shapes, numbers or names are wrong."""
        if np.shape(self.values) != (len(self.times), len(self.names)) or not np.all(
            np.isfinite(self.values)
        ):
            raise BadInputError(
                f"the commands have values of shape {np.shape(self.values)}; give"
                f" {len(self.times)} rows of {len(self.names)} finite numbers"
            )
        for name in self.names:
            if self.names.count(name) > 1:
                raise BadInputError(f"the command of {name} is given twice; remove one command")
        if len(self.times) and not (self.times[0] >= 0.0 and np.all(np.diff(self.times) > 0.0)):
            raise BadInputError(
                "the times of the commands do not increase from 0 s or later; give increasing "
                "times of at least 0 s"
            )

    def at(self, t: Any) -> ca.SX:
        """Return r(t), (k,), as a CasADi expression."""
        return self._summed(t, lambda late: _response(late).value)

    def rate(self, t: Any) -> ca.SX:
        """Return r'(t), (k,), as a CasADi expression."""
        return self._summed(t, lambda late: _response(late).rate)

    def _summed(self, t: Any, response: Callable[[Any], Any]) -> ca.SX:
        """Return Σ_i (R_i - R_i-1) response(t - t_i), (k,)."""
        total = ca.SX.zeros(len(self.names))
        jumps = np.diff(self.values, axis=0, prepend=np.zeros((1, len(self.names))))
        for begin, jump in zip(self.times.tolist(), jumps, strict=True):
            total = total + ca.DM(jump) * response(t - begin)
        return total


class _Response(NamedTuple):
    """Step response s of the command filter, and its time derivative s'."""

    value: Any
    rate: Any


def _response(late: Any) -> _Response:
    """Return the step response at τ = max(late, 0) s after a step."""
    # s = 1 - (q e^(-pτ) - p e^(-qτ)) / (q - p) with the poles -p and -q
    middle = DAMPING * BANDWIDTH
    apart = BANDWIDTH * math.sqrt(DAMPING**2 - 1.0)
    tau = ca.fmax(late, 0.0)
    p, q = middle - apart, middle + apart
    slow, fast = ca.exp(-p * tau), ca.exp(-q * tau)
    return _Response(1.0 - (q * slow - p * fast) / (q - p), p * q * (slow - fast) / (q - p))
