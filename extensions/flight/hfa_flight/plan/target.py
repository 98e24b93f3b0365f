"""Equilibria in moving air, at which plans end.

Source: Pannocchia and Rawlings, AIChE Journal 49 (2003) 426.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_flight.plan.held_model import HeldModel
from hfa_support.native.bound import BoundFunction

#: Weights that make the cheapest equilibrium unique, relative to the largest weights.
_UNIQUE = 1e-10
#: Fraction of the input limits within which an equilibrium lies.
_WITHIN = 0.98


class Target(NamedTuple):
    """Equilibrium at which a flight in constant winds ends, and the value about it.

    w: winds
    z, v: deviations of states and inputs from the trim, (n,) and (m,)
    P: matrix of the cost z'Pz at the end of a plan, (n, n)
    """

    w: np.ndarray
    z: np.ndarray
    v: np.ndarray
    P: np.ndarray

    def value(self, z: np.ndarray) -> float:
        """Return the linear cost (z - z_t)'P (z - z_t) of some states, (n,)."""
        away = z - self.z
        return float(away @ self.P @ away)


class CheapestEquilibrium:
    """Minimum of z'Qz + v'Rv subject to f(z, v, w) = 0 in the linear states.

    model: the aircraft in moving air
    """

    def __init__(self, model: HeldModel) -> None:
        self._model = model
        self._slopes = BoundFunction(model.slopes)
        k, _, m = model.scaled.sizes
        _, _, Q, R = model.scaled.linear_states
        self._weights = np.zeros((k + m, k + m))
        self._weights[:k, :k] = Q + _UNIQUE * np.abs(Q).max() * np.eye(k)
        self._weights[k:, k:] = R + _UNIQUE * np.abs(R).max() * np.eye(m)

    def __reduce__(self) -> tuple[type[CheapestEquilibrium], tuple[HeldModel]]:
        """Return the constructor and its argument, for copies and pickle."""
        return CheapestEquilibrium, (self._model,)

    def near(self, last: Target, w: np.ndarray) -> Target:
        """Return the target in the winds w, by one step of Newton's method from the last target.

        Inputs beyond a limit are held near it.
        """
        scaled = self._model.scaled
        k, n, m = scaled.sizes
        lowest, highest = (_WITHIN * limit for limit in scaled.input_limits)
        z, v = last.z, last.v
        rates, slopes = self._slopes.at(np.concatenate([z, v]), w)
        by_both = slopes.reshape(n + m, n).T[:k]
        moves = np.hstack([by_both[:, :k], by_both[:, n:]])
        aim = moves @ np.concatenate([z[:k], v]) - rates[:k]
        both = _constrained(self._weights, moves, aim, lowest, highest)
        z = np.concatenate([both[:k], np.zeros(n - k)])
        return Target(w, z, np.clip(both[k:], *scaled.input_limits), last.P)


def _constrained(
    weights: np.ndarray, moves: np.ndarray, aim: np.ndarray, lowest: np.ndarray, highest: np.ndarray
) -> np.ndarray:
    """Return the minimum x of x'Wx with M x = aim, whose last entries are held at passed limits.

    weights: W, (k + m, k + m)
    moves: M, (k, k + m)
    lowest, highest: limits of the last m entries
    """
    k = len(aim)
    x = np.zeros(len(weights))
    free = np.ones(len(weights), dtype=bool)
    for _ in range(len(lowest) + 1):
        M = moves[:, free]
        size = M.shape[1]
        system = np.block([[weights[np.ix_(free, free)], M.T], [M, -1e-9 * np.eye(k)]])
        known = np.concatenate([np.zeros(size), aim - moves[:, ~free] @ x[~free]])
        x[free] = np.linalg.solve(system, known)[:size]
        limited = np.clip(x[k:], lowest, highest)
        beyond = free[k:] & (limited != x[k:])
        if not beyond.any():
            break
        x[k:][beyond] = limited[beyond]
        free[k:] &= ~beyond
    return x
