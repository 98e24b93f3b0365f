"""Actuators of first and second order with position and rate limits, and their faults in flight."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.march.march import saturated
from hfa_support.errors import BadInputError, refuse_unknown, refuse_unless_positive

#: Longest integration step relative to the lag. For the actuators alone, the Runge-Kutta method of
#: order 4 is unstable beyond 2.785.
LONGEST_STEP = 2.5


@dataclass(frozen=True)
class ActuatorFault:
    """Change of the actuator dynamics during a flight, from the time `begin` on.

    begin: s
    effectiveness: λ, factor on the command
    bandwidth: ω, rad/s, or None for no change
    damping: ζ, or None for no change
    inputs: names of the affected inputs, or () for all

    Raises BadInputError if `begin` is negative or not finite, or another number is not positive.
    """

    begin: float = 0.0
    effectiveness: float = 1.0
    bandwidth: float | None = None
    damping: float | None = None
    inputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Raise BadInputError unless `begin` is at least 0 and the other numbers are positive."""
        for name in ("effectiveness", "bandwidth", "damping"):
            if (value := getattr(self, name)) is not None:
                refuse_unless_positive(f"the {name} after a fault", value)
        if not (math.isfinite(self.begin) and self.begin >= 0.0):
            raise BadInputError(f"the start time of a fault is {self.begin:g} s; give at least 0 s")


@dataclass(frozen=True)
class ActuatorBank:
    """Actuators of the m inputs, with limits of position and rate.

    u is the command and a the position, as deviations from the trim U0.

      c = sat(U0 + u, lowest, highest) - U0
      order 1:  a' = sat((λ c - a) ω, ±rate)
      order 2:  a' = sat(v, ±rate),  v' = ω² (λ c - a) - 2 ζ ω v,  a within its limits

    lag, lowest, highest and rate are named tuples over the inputs of the model
    (`hfa_aircraft.model.record`), in its units.

    lag: 1/ω, s, > 0
    lowest, highest: absolute positions, possibly infinite
    rate: largest |U'|, per s, possibly infinite
    order: 1 or 2, for all inputs
    damping: ζ, for all inputs
    faults: changes of ω, ζ and the effectiveness λ. Without a fault, λ is 1

    Raises BadInputError if a lag or a rate is not positive, a lowest position is not below the
    highest, the order is neither 1 nor 2, the damping is not positive, or a fault names an unknown
    input.
    """

    lag: Any
    lowest: Any
    highest: Any
    rate: Any
    order: int = 1
    damping: float = 0.7
    faults: tuple[ActuatorFault, ...] = ()

    def __post_init__(self) -> None:
        """Raise BadInputError for numbers or faults that the class does not permit."""
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
        for fault in self.faults:
            for name in fault.inputs:
                refuse_unknown("a fault has no input", name, self.inputs)

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

    @property
    def held_size(self) -> int:
        """Number of actuator parameters that are inputs of the loop: 3 m, or 0 without faults."""
        return 3 * len(self.lag) if self.faults else 0

    @property
    def breaks(self) -> list[float]:
        """Times at which faults begin, s."""
        return [fault.begin for fault in self.faults]

    def held_inputs(self, time: float) -> np.ndarray:
        """Return the actuator parameters [ω; ζ; λ], (3 m,), at a time in s.

        If several faults change a parameter, the last one in `faults` that has begun applies.
        """
        m = len(self.lag)
        values = np.concatenate([1.0 / np.array(self.lag), np.full(m, self.damping), np.ones(m)])
        for fault in self.faults:
            if time >= fault.begin - 1e-9:
                columns = np.array(
                    [self.inputs.index(name) for name in fault.inputs or self.inputs]
                )
                for row, value in enumerate((fault.bandwidth, fault.damping, fault.effectiveness)):
                    if value is not None:
                        values[row * m + columns] = value
        return values

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

    def states_rate(self, states: ca.SX, reachable: ca.SX, held: ca.SX) -> ca.SX:
        """Return the time derivative of the actuator states.

        states: positions a and, for order 2, rates v
        reachable: c, (m,)
        held: `held_inputs`, or empty without faults
        """
        numbers = held if self.faults else ca.SX(ca.DM(self.held_inputs(0.0)))
        bandwidth, damping, effectiveness = ca.vertsplit(numbers, len(self.lag))
        fastest = np.array(self.rate, dtype=float)
        positions = states[: len(self.lag)]
        missing = effectiveness * reachable - positions
        if self.order == 1:
            return saturated(bandwidth * missing, -fastest, fastest)
        speeds = states[len(self.lag) :]
        accelerations = bandwidth * (bandwidth * missing - 2 * damping * speeds)
        return ca.vertcat(saturated(speeds, -fastest, fastest), accelerations)
