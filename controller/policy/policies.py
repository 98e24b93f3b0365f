"""Policies that fly: a control law as CasADi expressions, with a memory of its own where it has one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np

from controller.policy.signals import Signal
from hfa_model.vectors import INPUTS, LINEAR_STATES

_N, _M = len(LINEAR_STATES), len(INPUTS)


class Seen(NamedTuple):
    """What a policy is told of the flight, as deviations from trim, noise of the sensors included.

    error: x - x_d (6,), of the states of the linear model. states: x (6,). positions, rates: of the actuators, (5,)
    each; empty where there are none. updraft: of the air, ft/s, one number or (2,) at the center and the outer panels;
    empty in still air. A policy does not know it: what it measures of loads and angles through the air is made of it.
    """

    error: ca.SX
    states: ca.SX
    positions: ca.SX
    rates: ca.SX
    updraft: ca.SX = ca.SX(0, 1)


class Policy(Protocol):
    """u = control(t, seen, memory, p), memory' = memory_rate(t, seen, memory, p, u_applied).

    memory: what the policy integrates (weights of a critic, say). p: what is handed to it anew at every tick (a gain
    that is learned elsewhere, say). u_applied: u within the limits of position; u itself where there are none.
    """

    @property
    def memory_size(self) -> int:
        """Number of states of its own."""

    @property
    def constants_size(self) -> int:
        """Length of p."""

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """Commanded input deviation, (5,)."""

    def memory_rate(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX, applied: ca.SX) -> ca.SX:
        """d(memory)/dt, (memory_size,)."""


class Memoryless:
    """A policy or a gust without states of its own."""

    memory_size = 0

    def memory_rate(self, *_: object) -> ca.SX:
        """No states, so no rates: (0,)."""
        return ca.SX(0, 1)

    def start(self) -> np.ndarray:
        """No states, (0,)."""
        return np.zeros(0)


class Unvaried:
    """What is handed no constants: a policy or a gust that is the same at every tick, a plant of known numbers."""

    constants_size = 0

    def constants(self, tick: int) -> np.ndarray:
        """Nothing, (0,)."""
        return np.zeros(0)


@dataclass(frozen=True, eq=False)
class GainPolicy(Memoryless):
    """u = -K z + v(t), K from p, column by column (`gain_constants`); v: feedforward, (5,)."""

    constants_size = _M * _N

    feedforward: Signal

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """-K z + v(t)."""
        return -ca.mtimes(ca.reshape(p, _M, _N), seen.error) + self.feedforward.at(t)


def gain_constants(K: np.ndarray) -> np.ndarray:
    """The p of `GainPolicy` for a gain K (5, 6)."""
    return np.asarray(K, dtype=float).ravel(order="F")


@dataclass(frozen=True, eq=False)
class TrackingPolicy(Memoryless):
    """u = -K z + F w(t), K (5, 6) and F (5, k) from p (`tracking_constants`).

    generator: w (k,), the signals that the reference is made of.
    """

    generator: Signal

    @property
    def constants_size(self) -> int:
        """The entries of K and F."""
        return _M * (_N + self.generator.size)

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """-K z + F w(t)."""
        feedback = ca.mtimes(ca.reshape(p[: _M * _N], _M, _N), seen.error)
        feedforward = ca.mtimes(ca.reshape(p[_M * _N :], _M, self.generator.size), self.generator.at(t))
        return feedforward - feedback


def tracking_constants(K: np.ndarray, F: np.ndarray) -> np.ndarray:
    """The p of `TrackingPolicy` for K (5, 6) and F (5, k)."""
    return np.concatenate([gain_constants(K), np.asarray(F, dtype=float).ravel(order="F")])
