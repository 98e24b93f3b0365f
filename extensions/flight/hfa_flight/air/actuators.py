"""Actuators of first and second order with position and rate limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.march import saturated
from hfa_support.errors import BadInputError, refuse_unless_positive

#: Longest integration step relative to the lag. For the actuators alone, the Runge-Kutta method of
#: order 4 is unstable beyond 2.785.
LONGEST_STEP = 2.5


@dataclass(frozen=True)
class ActuatorBank:
    """Actuators of the m inputs, with limits of position and rate.

    u is the command and a the position, as deviations from the trim U0.

      c = sat(U0 + u, lowest, highest) - U0
      order 1:  a' = sat((c - a) ω, ±rate)
      order 2:  a' = sat(v, ±rate),  v' = ω² (c - a) - 2 ζ ω v,  a within its limits

    lag, lowest, highest and rate are named tuples over the inputs of the model
    (`hfa_aircraft.model.record`), in its units.

    lag: 1/ω, s, > 0
    lowest, highest: absolute positions, possibly infinite
    rate: largest |U'|, per s, possibly infinite
    order: 1 or 2, for all inputs
    damping: ζ, for all inputs

    Raises BadInputError if a lag or a rate is not positive, a lowest position is not below the
    highest, the order is neither 1 nor 2, or the damping is not positive.
    """

    lag: Any
    lowest: Any
    highest: Any
    rate: Any
    order: int = 1
    damping: float = 0.7

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
        if self.order not in (1, 2):
            raise BadInputError(f"the order of the actuators is {self.order}; give 1 or 2")
        refuse_unless_positive("the damping of the actuators", self.damping)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the m inputs that the actuators move."""
        return tuple(self.lag._fields)

    def refuse_step(self, step: float) -> None:
        """Raise BadInputError if an integration step is too long for the lag of an actuator.

        step: s
        """
        for name, lag in zip(self.inputs, self.lag, strict=True):
            if step > LONGEST_STEP * lag * (1 + 1e-9):
                raise BadInputError(
                    f"the lag of {name} is {lag:g} s, but a step of {step:g} s requires at least"
                    f" {step / LONGEST_STEP:g} s; increase the lag or shorten the step"
                )

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

    @property
    def size(self) -> int:
        """Number of actuator states: m for order 1 and 2 m for order 2.

        The states are the m positions a and, for order 2, the m rates v. All are deviations from
        trim.
        """
        return self.order * len(self.lag)

    def reachable(self, command: ca.SX, trim: np.ndarray) -> ca.SX:
        """Return the command clipped to the position limits: c, (m,), as a deviation from trim.

        command: u, (m,)
        trim: U0, (m,)
        """
        return saturated(command, np.array(self.lowest) - trim, np.array(self.highest) - trim)

    def position(self, states: ca.SX, trim: np.ndarray) -> ca.SX:
        """Return the actuator positions a, (m,), the inputs of the aircraft.

        For order 2, the positions are clipped to the position limits.

        states: states of the actuators
        trim: U0, (m,)
        """
        return states if self.order == 1 else self.reachable(states[: len(self.lag)], trim)

    def states_rate(self, states: ca.SX, reachable: ca.SX) -> ca.SX:
        """Return the time derivative of the actuator states.

        states: positions a and, for order 2, rates v
        reachable: c, (m,)
        """
        bandwidth = ca.DM(1.0 / np.array(self.lag))
        fastest = np.array(self.rate, dtype=float)
        missing = reachable - states[: len(self.lag)]
        if self.order == 1:
            return saturated(bandwidth * missing, -fastest, fastest)
        speeds = states[len(self.lag) :]
        accelerations = bandwidth * (bandwidth * missing - 2 * self.damping * speeds)
        return ca.vertcat(saturated(speeds, -fastest, fastest), accelerations)
