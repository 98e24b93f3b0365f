"""Actuators of first order with position and rate limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import saturated
from hfa_support.errors import BadInputError, refuse_unless_positive


@dataclass(frozen=True)
class ActuatorBank:
    """Actuators of the m inputs, with limits of position and rate.

    u is the command and a the position, as deviations from the trim U0.

      c = sat(U0 + u, lowest, highest) - U0
      a' = sat((c - a) / lag, ±rate)

    lag, lowest, highest and rate are named tuples over the inputs of the model
    (`hfa_aircraft.signals.record`), in its units.

    lag: s, > 0
    lowest, highest: absolute positions, possibly infinite
    rate: largest |U'|, per s, possibly infinite

    Raises BadInputError if a lag or a rate is not positive, or a lowest position is not below the
    highest.
    """

    lag: Any
    lowest: Any
    highest: Any
    rate: Any

    def __post_init__(self) -> None:
        """Raise BadInputError for numbers that the class does not permit."""
        numbers = zip(self.inputs, self.lag, self.lowest, self.highest, self.rate, strict=True)
        for name, lag, lowest, highest, rate in numbers:
            refuse_unless_positive(f"the lag of {name}", lag, " s")
            if not rate > 0.0:
                raise BadInputError(
                    f"the rate limit of {name} is {rate}; give a positive rate (inf for none)"
                )
            if not lowest < highest:
                raise BadInputError(
                    f"the position limits of {name} are {lowest} and {highest}; give two "
                    "different numbers, the lower first"
                )

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the m inputs that the actuators move."""
        return tuple(self.lag._fields)

    def refuse_trim(self, trim: np.ndarray) -> None:
        """Raise BadInputError if a trim input is outside the position limits of its actuator.

        trim: U0, (m,)
        """
        rows = zip(self.inputs, trim, self.lowest, self.highest, strict=True)
        for name, value, lowest, highest in rows:
            if not lowest <= value <= highest:
                raise BadInputError(
                    f"{name} is {value:.6g} at trim, outside the limits of the actuator, "
                    f"{lowest:.6g} to {highest:.6g}; widen the limits"
                )

    def reachable(self, command: ca.SX, trim: np.ndarray) -> ca.SX:
        """Return the command clipped to the position limits: c, (m,), as a deviation from trim.

        command: u, (m,)
        trim: U0, (m,)
        """
        return saturated(command, np.array(self.lowest) - trim, np.array(self.highest) - trim)

    def rates(self, positions: ca.SX, reachable: ca.SX) -> ca.SX:
        """Return the time derivative of the positions.

        positions: a, (m,)
        reachable: c, (m,)
        """
        fastest = np.array(self.rate, dtype=float)
        return saturated((reachable - positions) * (1.0 / np.array(self.lag)), -fastest, fastest)
