"""Policies that fly: a control law as CasADi expressions, with its memory, if any; and a law that
is ready to fly: a policy, its constants tick by tick, and its memory at the start."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.flight.signals import CommandSteps
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown
from hfa_support.reporting.fields import Shown


class Seen(NamedTuple):
    """Inputs of a policy, as deviations from trim, noise of the sensors included.

    error: x - x_d (k,), of the states of the linear model. states: x (k,). positions, rates: of the
    actuators, (m,) each; empty where there are none. updraft: of the air, ft/s; empty in still air.
    A policy does not know it: what it measures of loads and angles through the air is made of it.
    """

    error: ca.SX
    states: ca.SX
    positions: ca.SX
    rates: ca.SX
    updraft: ca.SX = ca.SX(0, 1)


class Policy(Protocol):
    """u = control(t, seen, memory, p), memory' = memory_rate(t, seen, memory, p, u_applied).

    memory: what the policy integrates (weights of a critic, say). p: what is handed to it anew at
    every tick (a gain that is learned elsewhere, say). u_applied: u within the limits of position;
    u itself where there are none."""

    @property
    def memory_size(self) -> int:
        """Number of its states."""

    @property
    def constants_size(self) -> int:
        """Length of p."""

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """Commanded input deviation, (m,)."""

    def memory_rate(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX, applied: ca.SX) -> ca.SX:
        """d(memory)/dt, (memory_size,)."""


class Memoryless:
    """A policy or a gust without states."""

    memory_size = 0

    def memory_rate(self, *_: object) -> ca.SX:
        """No states, so no rates: (0,)."""
        return ca.SX(0, 1)

    def start(self) -> np.ndarray:
        """No states, (0,)."""
        return np.zeros(0)


class Unvaried:
    """What is handed no constants: a policy or a gust that is the same at every tick, a plant of
    known numbers."""

    constants_size = 0

    def constants(self, tick: int) -> np.ndarray:
        """Nothing, (0,)."""
        return np.zeros(0)


@dataclass(frozen=True)
class GainPolicy(Memoryless):
    """u = -K z, K (inputs, states) from p, column by column (`gain_constants`)."""

    inputs: int
    states: int

    @property
    def constants_size(self) -> int:
        """Entries of K."""
        return self.inputs * self.states

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """-K z."""
        return -ca.mtimes(ca.reshape(p, self.inputs, self.states), seen.error)


@dataclass(frozen=True)
class OpenLoop(Memoryless):
    """u = p: inputs (m,) held in each tick, whatever is seen."""

    constants_size: int

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """p."""
        return p


def open_loop(commands: CommandSteps, inputs: tuple[str, ...], tick: float, ticks: int) -> FlownLaw:
    """No law: steps of inputs off trim, as they are, from the first tick at or after each time.

    BadInputError for a name that is no input.
    """
    for name in commands.names:
        refuse_unknown("there is no law, and no input", name, inputs)
    table = np.zeros((ticks, len(inputs)))
    for row, time in zip(commands.values, commands.times, strict=True):
        table[math.ceil(time / tick - 1e-9) :, [inputs.index(name) for name in commands.names]] = (
            row
        )
    return FlownLaw("none", OpenLoop(len(inputs)), table, identity={"u": table})


def gain_constants(K: np.ndarray) -> np.ndarray:
    """The p of `GainPolicy` for a gain K (m, k)."""
    return np.asarray(K, dtype=float).ravel(order="F")


@dataclass(frozen=True, eq=False, repr=False)
class FlownLaw(Shown):
    """u and memory' of `policy`, with p = table[k] in tick k, the last row staying, and memory(0) =
    memory.

    table: (N, k). memory: (m,). identity: JSON data that decides what it does. fastest: of its own
    modes, 1/s, as far as it is known; decides how it is integrated."""

    name: str
    policy: Policy
    table: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)))
    memory: np.ndarray = field(default_factory=lambda: np.zeros(0))
    identity: Mapping[str, object] = field(default_factory=dict)
    fastest: float = 0.0

    def constants(self, tick: int) -> np.ndarray:
        """p in a tick, (k,)."""
        row: np.ndarray = self.table[min(tick, len(self.table) - 1)]
        return row

    @property
    def gains(self) -> np.ndarray:
        """K in each tick, (N, m, k), of a `GainPolicy`; none, (0, 0, 0), of another."""
        if not isinstance(self.policy, GainPolicy):
            return np.zeros((0, 0, 0))
        return self.table.reshape(-1, self.policy.states, self.policy.inputs).transpose(0, 2, 1)


def gain_law(name: str, gains: np.ndarray) -> FlownLaw:
    """u = -K z. gains: K (m, k), or that of each tick (N, m, k); else BadInputError."""
    K = numbers_in("the gain", gains)
    if K.ndim not in (2, 3) or not K.size or not np.all(np.isfinite(K)):
        raise BadInputError(
            f"the gain has shape {np.shape(gains)}; give inputs x states finite numbers"
        )
    table = np.array([gain_constants(each) for each in K.reshape(-1, *K.shape[-2:])])
    return FlownLaw(name, GainPolicy(*K.shape[-2:]), table, identity={"K": K})
