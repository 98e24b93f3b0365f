"""Constant disturbances, estimated from the last samples, and the equilibrium they leave.

Source: Pannocchia and Rawlings, AIChE Journal 49 (2003) 426.
"""

from __future__ import annotations

import numpy as np

from hfa_optimal.planner import Planner, Target
from hfa_support.native.bound import BoundFunction

#: Fraction of the difference between measured and predicted rates by which an estimate moves at
#: each sample.
_SHARE = 0.8
#: Largest magnitude of the model's own disturbance, nominal values.
_MOST = 3.0
#: Weights that make the cheapest equilibrium unique, relative to the largest weights.
_UNIQUE = 1e-10
#: Fraction of the input limits within which an equilibrium lies.
_WITHIN = 0.98


class DisturbanceEstimate:
    """Estimate of disturbances d that explain the last samples, and the target of the flight.

      z' = f(z, v, w) + d,    d and w constant

    One constant is added to each rate. If the planner has a disturbance w of the model, w explains
    what it can of the difference, and the rates the rest.

    d: the constants added to the rates, then w, in nominal values
    target: cheapest equilibrium under d, in the linear states
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._slopes = BoundFunction(planner.model.slopes)
        self.clear()

    def clear(self) -> None:
        """Begin again, without disturbance and with the trim as target."""
        _, n, m = self._planner.scaled.sizes
        self.d = np.zeros(self._planner.model.disturbances)
        self.target = Target(np.zeros(n), np.zeros(m))

    def update(self, z: np.ndarray, before: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Change the estimate by the difference of the measured states from their prediction.

        z: measured states, (n,)
        before: states and inputs one sample earlier, and the states predicted from them for now
        """
        n = self._planner.scaled.sizes[1]
        earlier, v, predicted = before
        missing = (z - predicted) / self._planner.grid.dt
        if len(self.d) > n:
            _, _, gradient = self._slopes.at(np.concatenate([earlier, v]), self.d[n:])
            change = gradient @ missing / (gradient @ gradient + 1e-9)
            missing = missing - gradient * change
            self.d[n] = np.clip(self.d[n] + _SHARE * change, -_MOST, _MOST)
        self.d[:n] += _SHARE * missing
        self.target = self._cheapest_equilibrium()

    def _cheapest_equilibrium(self) -> Target:
        """Return the minimum of z'Qz + v'Rv subject to f(z, v, w) + d = 0 in the linear states.

        The equations are linearized at the last target, once a sample. Inputs beyond a limit are
        held near it.
        """
        scaled = self._planner.scaled
        k, n, m = scaled.sizes
        _, _, Q, R = scaled.linear_states
        lowest, highest = (_WITHIN * limit for limit in scaled.input_limits)
        weights = np.zeros((k + m, k + m))
        weights[:k, :k] = Q + _UNIQUE * np.abs(Q).max() * np.eye(k)
        weights[k:, k:] = R + _UNIQUE * np.abs(R).max() * np.eye(m)
        z, v = self.target
        rates, slopes, _ = self._slopes.at(np.concatenate([z, v]), self.d[n:])
        by_both = slopes.reshape(n + m, n).T[:k]
        moves = np.hstack([by_both[:, :k], by_both[:, n:]])
        aim = moves @ np.concatenate([z[:k], v]) - rates[:k] - self.d[:k]
        both = _constrained(weights, moves, aim, lowest, highest)
        z = np.concatenate([both[:k], np.zeros(n - k)])
        v = np.clip(both[k:], *scaled.input_limits)
        return Target(z, v)


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
