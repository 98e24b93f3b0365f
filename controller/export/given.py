"""What a simulation works out and an exported controller is told: commands, measured outputs, updraft, held inputs."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controller.policy.policies import Memoryless, Seen, Unvaried


class GivenCommands(NamedTuple):
    """r, r' and the value that r is on its way to, (k,) each, as arguments; the `commands` of a `ServoPolicy`."""

    names: tuple[str, ...]
    value: ca.SX
    slope: ca.SX
    goal: ca.SX

    def at(self, t: Any) -> ca.SX:
        """The value r, (k,)."""
        return self.value

    def rate(self, t: Any) -> ca.SX:
        """Its rate, (k,)."""
        return self.slope

    def end(self, t: Any) -> ca.SX:
        """What r is on its way to."""
        return self.goal


class GivenOutputs(NamedTuple):
    """y - Y0, (k,), as an argument; the `outputs` of a `ServoPolicy`."""

    values: ca.SX

    def at(self, seen: Seen) -> ca.SX:
        """y - Y0."""
        return self.values


class GivenInputs(Memoryless, Unvaried):
    """u, (5,), as an argument; the policy of a loop whose inputs are held from outside."""

    def __init__(self, values: ca.SX) -> None:
        self._values = values

    def control(self, *_: object) -> ca.SX:
        """The argument u."""
        return self._values


class GivenUpdraft(Memoryless, Unvaried):
    """w, ft/s, as an argument; the gust of a loop."""

    def __init__(self, value: ca.SX) -> None:
        self._value = value

    def updraft(self, t: Any, memory: Any, p: Any) -> ca.SX:
        """The argument w."""
        return self._value

    def start(self) -> np.ndarray:
        """No states, (0,)."""
        return np.zeros(0)

    def constants(self, tick: int) -> np.ndarray:
        """Nothing, (0,)."""
        return np.zeros(0)
