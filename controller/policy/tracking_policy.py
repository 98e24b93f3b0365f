"""Feedback and feedforward that may both change from tick to tick."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controller.policy.policies import Memoryless, Seen, gain_constants
from controller.policy.signals import Signal
from hfa_model.vectors import INPUTS, LINEAR_STATES

_N, _M = len(LINEAR_STATES), len(INPUTS)


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
