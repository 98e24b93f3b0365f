"""Actuators of order 1 and 2 with limits of position and rate, and what may befall them in flight."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from hfa_model.vectors import INPUTS, Input
from hfa_support.errors import BadInputError, refuse_unknown, refuse_unless_positive

#: Longest step of the integration, in lags: Runge-Kutta 4 blows up beyond 2.785 on the actuators alone.
LONGEST_STEP = 2.5
_M = len(INPUTS)


@dataclass(frozen=True)
class ActuatorFault:
    """From `begin` (s) on the actuators of `inputs` have another effectiveness λ, bandwidth ω (rad/s) and damping ζ.

    bandwidth, damping: None leaves them as they were. BadInputError when a number is not positive, or a name unknown.
    """

    begin: float = 0.0
    effectiveness: float = 1.0
    bandwidth: float | None = None
    damping: float | None = None
    inputs: tuple[str, ...] = INPUTS[1:]

    def __post_init__(self) -> None:
        """Refuse what cannot be flown."""
        for name in ("effectiveness", "bandwidth", "damping"):
            if (value := getattr(self, name)) is not None:
                refuse_unless_positive(f"the {name} after a fault", value)
        if not (math.isfinite(self.begin) and self.begin >= 0.0):
            raise BadInputError(f"a fault begins at {self.begin:g} s; give a time from 0 on")
        for name in self.inputs:
            refuse_unknown("a fault has no input", name, INPUTS)


@dataclass(frozen=True)
class Actuators:
    """Five actuators: c = sat(U0 + u, lowest, highest) - U0 of the commanded deviation u, and

        order 1:  a' = sat((λ c - a) ω, ±rate),
        order 2:  a' = sat(v, ±rate),  v' = ω² (λ c - a) - 2 ζ ω v,  the position staying within its limits.

    lag: 1/ω, s, > 0. lowest, highest: positions, absolute. rate: largest |U'|, per s. λ = 1 until a fault.
    Units of `INPUTS`: throttle in its own unit, deflections in rad. Limits may be infinite. BadInputError when
    a lag or a rate is not positive, a lowest position is not below the highest, or the order is another.
    """

    lag: Input
    lowest: Input
    highest: Input
    rate: Input
    order: int = 1
    damping: float = 0.7
    faults: tuple[ActuatorFault, ...] = ()

    def __post_init__(self) -> None:
        """Refuse what cannot move, naming the actuator."""
        for name, lag, lowest, highest, rate in zip(
            INPUTS, self.lag, self.lowest, self.highest, self.rate, strict=True
        ):
            refuse_unless_positive(f"the lag of {name}", lag, " s")
            if not rate > 0.0:
                raise BadInputError(f"the rate limit of {name} is {rate}; it must be positive (inf for none)")
            if not lowest < highest:
                raise BadInputError(f"the positions of {name} go from {lowest} to {highest}; give the lower one first")
        if self.order not in (1, 2):
            raise BadInputError(f"the order of the actuators is {self.order}; it must be 1 or 2")
        refuse_unless_positive("the damping of the actuators", self.damping)

    def refuse_step(self, step: float) -> None:
        """BadInputError, naming the actuator, when a lag is too short for the step of the integration, s."""
        for name, lag in zip(INPUTS, self.lag, strict=True):
            if step > LONGEST_STEP * lag * (1 + 1e-9):
                raise BadInputError(
                    f"the lag of {name} is {lag:g} s; with a step of {step:g} s it must be at least"
                    f" {step / LONGEST_STEP:g} s: make the lag longer or the step shorter"
                )

    def refuse_trim(self, trim: np.ndarray) -> None:
        """BadInputError, naming the actuator, when U0 (5,) is no position that it can hold."""
        for name, at, lowest, highest in zip(INPUTS, trim, self.lowest, self.highest, strict=True):
            if not lowest <= at <= highest:
                raise BadInputError(
                    f"{name} is {at:.6g} at trim, outside its actuator's {lowest:.6g} to {highest:.6g}; widen them"
                )

    @property
    def size(self) -> int:
        """Number of states: positions a, then v of order 2; as deviations from trim."""
        return self.order * _M

    @property
    def constants_size(self) -> int:
        """Bandwidths, dampings and effectivenesses where a fault changes them; else none."""
        return 3 * _M if self.faults else 0

    def constants(self, time: float) -> np.ndarray:
        """[ω; ζ; λ] at a time, s, (15,); (0,) without faults."""
        return self._numbers(time) if self.faults else np.zeros(0)

    def _numbers(self, time: float) -> np.ndarray:
        values = np.concatenate([1.0 / np.array(self.lag), np.full(_M, self.damping), np.ones(_M)])
        for fault in self.faults:
            if time >= fault.begin - 1e-9:
                places = np.array([INPUTS.index(name) for name in fault.inputs])
                for row, value in enumerate((fault.bandwidth, fault.damping, fault.effectiveness)):
                    if value is not None:
                        values[row * _M + places] = value
        return values

    def reachable(self, command: ca.SX, trim: np.ndarray) -> ca.SX:
        """c, (5,)."""
        return _clipped(command, np.array(self.lowest) - trim, np.array(self.highest) - trim)

    def position(self, states: ca.SX, trim: np.ndarray) -> ca.SX:
        """a, (5,): what the aircraft gets."""
        return states if self.order == 1 else self.reachable(states[:_M], trim)

    def rates(self, states: ca.SX) -> ca.SX:
        """v, (5,), of order 2; (0,) of order 1."""
        return states[_M:]

    def states_rate(self, states: ca.SX, reachable: ca.SX, p: ca.SX) -> ca.SX:
        """Time derivative of the states. reachable: c. p: of `constants`."""
        numbers = p if self.faults else ca.SX(ca.DM(self._numbers(0.0)))
        bandwidth, damping, effectiveness = numbers[:_M], numbers[_M : 2 * _M], numbers[2 * _M :]
        fastest = np.array(self.rate, dtype=float)
        away = effectiveness * reachable - states[:_M]
        if self.order == 1:
            return _clipped(bandwidth * away, -fastest, fastest)
        v = states[_M:]
        return ca.vertcat(_clipped(v, -fastest, fastest), bandwidth * (bandwidth * away - 2 * damping * v))


def _clipped(value: ca.SX, lowest: np.ndarray, highest: np.ndarray) -> ca.SX:
    return ca.fmin(ca.fmax(value, ca.DM(lowest)), ca.DM(highest))
