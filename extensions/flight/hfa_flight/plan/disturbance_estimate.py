"""Constant disturbances, estimated from the last samples, and the equilibrium they leave.

Source: Pannocchia and Rawlings, AIChE Journal 49 (2003) 426.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa_flight.plan.planner import Planner, Target
from hfa_support.native.bound import BoundFunction

#: Fraction of the difference between measured and predicted rates by which an estimate moves at
#: each sample.
_SHARE = 0.8
#: Share of the rates that the inputs can make, by which one sample changes the estimate at most,
#: besides the rates in the usual box. One wrong sample then loses no flight.
_OF_MOVES = 0.1
#: Largest magnitude of the model's own disturbance, nominal values.
_MOST = 3.0
#: Weights that make the cheapest equilibrium unique, relative to the largest weights.
_UNIQUE = 1e-10
#: Fraction of the input limits within which an equilibrium lies.
_WITHIN = 0.98


class LastSample(NamedTuple):
    """Last sample of a flight: states z (n,), the mean v (m,) of the inputs that act until the next
    sample, and the states predicted for it, (n,).
    """

    z: np.ndarray
    v: np.ndarray
    predicted: np.ndarray


class DisturbanceEstimate:
    """Estimate of disturbances d that explain the last samples, and the target of the flight.

      z' = f(z, v, w) + d,    d and w constant

    One constant is added to each rate. If the planner has a disturbance w of the model, w explains
    what it can of the difference, and the rates the rest. A vector of disturbances contains the
    constants d, then w, in nominal values.

    planner: plans of the policy, with its model
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._slopes = BoundFunction(planner.model.slopes)
        scaled = planner.scaled
        k, n, _ = scaled.sizes
        A, B, _, _ = scaled.linear_states
        lowest, highest = scaled.input_limits
        ranges = np.where(np.isfinite(highest - lowest), highest - lowest, 1.0)
        usual = np.maximum(np.abs(A) @ scaled.box, scaled.box)
        #: Largest difference of a rate from its prediction that one sample may add, (n,).
        self._most = np.append(usual + _OF_MOVES * np.abs(B) @ ranges, np.full(n - k, np.inf))

    def __reduce__(self) -> tuple[type[DisturbanceEstimate], tuple[Planner]]:
        """Return the constructor and its argument, for copies and pickle."""
        return DisturbanceEstimate, (self._planner,)

    def updated(self, d: np.ndarray, z: np.ndarray, before: LastSample) -> np.ndarray:
        """Return the disturbances after a sample.

        d: disturbances before it
        z: measured states, (n,)
        """
        n = self._planner.scaled.sizes[1]
        d = d.copy()
        missing = (z - before.predicted) / self._planner.grid.dt
        missing = np.clip(missing, -self._most, self._most)
        if len(d) > n:
            _, _, gradient = self._slopes.at(np.concatenate([before.z, before.v]), d[n:])
            change = gradient @ missing / (gradient @ gradient + 1e-9)
            missing = missing - gradient * change
            d[n] = np.clip(d[n] + _SHARE * change, -_MOST, _MOST)
        d[:n] += _SHARE * missing
        return d

    def target(self, d: np.ndarray, last: Target) -> Target:
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
        z, v = last.z, last.v
        rates, slopes, _ = self._slopes.at(np.concatenate([z, v]), d[n:])
        by_both = slopes.reshape(n + m, n).T[:k]
        moves = np.hstack([by_both[:, :k], by_both[:, n:]])
        aim = moves @ np.concatenate([z[:k], v]) - rates[:k] - d[:k]
        both = _constrained(weights, moves, aim, lowest, highest)
        z = np.concatenate([both[:k], np.zeros(n - k)])
        v = np.clip(both[k:], *scaled.input_limits)
        return Target(d, z, v, last.P)


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
