"""First-order actuators with limits of position and rate, as a stage between a policy and its plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.policies import Policy
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, Input

#: Longest step of the integration, in lags: Runge-Kutta 4 blows up beyond 2.785 on the actuators alone.
LONGEST_STEP = 2.5


@dataclass(frozen=True)
class Actuators:
    """Five actuators. lag: time constants τ, s, > 0. lowest, highest: positions, absolute. rate: largest |U'|, per s.

    Units of `INPUTS`: throttle in its own unit, deflections in rad. Limits may be infinite. BadInputError when
    a lag or a rate is not positive or a lowest position is not below the highest.
    """

    lag: Input
    lowest: Input
    highest: Input
    rate: Input

    def __post_init__(self) -> None:
        """Refuse what cannot move, naming the actuator."""
        for name, lag, lowest, highest, rate in zip(
            INPUTS, self.lag, self.lowest, self.highest, self.rate, strict=True
        ):
            if not (np.isfinite(lag) and lag > 0.0):
                raise BadInputError(f"the lag of {name} is {lag} s; it must be a positive number")
            if not rate > 0.0:
                raise BadInputError(f"the rate limit of {name} is {rate}; it must be positive (inf for none)")
            if not lowest < highest:
                raise BadInputError(f"the positions of {name} go from {lowest} to {highest}; give the lower one first")

    def refuse_step(self, step: float) -> None:
        """BadInputError, naming the actuator, when a lag is too short for the step of the integration, s."""
        for name, lag in zip(INPUTS, self.lag, strict=True):
            if step > LONGEST_STEP * lag * (1 + 1e-9):
                raise BadInputError(
                    f"the lag of {name} is {lag:g} s; with a step of {step:g} s it must be at least"
                    f" {step / LONGEST_STEP:g} s: make the lag longer or the step shorter"
                )


@dataclass(frozen=True, eq=False)
class ActuatedPolicy:
    """A policy behind actuators: a' = sat((c - a)/τ, ±rate),  c = sat(U0 + u_policy, lowest, highest) - U0.

    The plant gets u = a. Clipping the command keeps the position within its limits too: a moves toward c alone.
    trim: U0 (5,), within the limits, or BadInputError. Memory: the policy's own, then a (5,), which starts at 0.
    """

    policy: Policy
    actuators: Actuators
    trim: np.ndarray

    def __post_init__(self) -> None:
        """The trim must be a position that the actuators can hold."""
        for name, at, lowest, highest in zip(
            INPUTS, self.trim, self.actuators.lowest, self.actuators.highest, strict=True
        ):
            if not lowest <= at <= highest:
                raise BadInputError(
                    f"{name} is {at:.6g} at trim, outside its actuator's {lowest:.6g} to {highest:.6g}; widen them"
                )

    @property
    def memory_size(self) -> int:
        """The policy's own states and five positions."""
        return self.policy.memory_size + len(INPUTS)

    @property
    def constants_size(self) -> int:
        """The policy's."""
        return self.policy.constants_size

    def control(self, t: Any, z: Any, memory: Any, p: Any) -> Any:
        """The positions a, as deviations from trim."""
        return memory[self.policy.memory_size :]

    def memory_rate(self, t: Any, z: Any, memory: Any, p: Any) -> Any:
        """Rates of the policy's own states and of the positions."""
        own, position = memory[: self.policy.memory_size], memory[self.policy.memory_size :]
        limits = self.actuators
        command = self.policy.control(t, z, own, p)
        reachable = _clipped(command, np.array(limits.lowest) - self.trim, np.array(limits.highest) - self.trim)
        fastest = np.array(limits.rate, dtype=float)
        rate = _clipped((reachable - position) / ca.DM(np.array(limits.lag)), -fastest, fastest)
        return ca.vertcat(self.policy.memory_rate(t, z, own, p), rate)


def _clipped(value: Any, lowest: np.ndarray, highest: np.ndarray) -> Any:
    return ca.fmin(ca.fmax(value, ca.DM(lowest)), ca.DM(highest))
