"""Linear policy at the end of a predictive policy's flight, and where it may take over."""

from __future__ import annotations

import numpy as np

from hfa_flight.plan.hold import Hold
from hfa_flight.plan.scaled import ScaledProblem
from hfa_flight.plan.target import Target

#: Fraction of the limits within which the linear loop stays.
_WITHIN = 0.9
#: Numbers of samples of the linear loop that are checked one by one, and of further steps of
#: _LONGER samples each.
_SAMPLES = 150
_STEPS = 100
_LONGER = 10
#: Least distance from a target to a limit, nominal values.
_LEAST = 1e-9


class EndLaw:
    """Exact held gain v = v_t - K (z - z_t), where the linear loop keeps all limits.

    The set of these states is the maximal output admissible set of the linear loop.

    scaled: the problem in nominal units
    hold: linear model over a sample
    K: gain, (m, k)
    poles: eigenvalues of the held linear loop, (k,)

    Source: Gilbert and Tan, IEEE Transactions on Automatic Control 36 (1991) 1008.
    """

    def __init__(self, scaled: ScaledProblem, hold: Hold, K: np.ndarray) -> None:
        k = scaled.sizes[0]
        self.K = K
        self._scaled = scaled
        loop = hold.A - hold.B @ K
        self.poles = np.asarray(np.linalg.eigvals(loop))
        longer = np.linalg.matrix_power(loop, _LONGER)
        moved = np.eye(k)
        rows = []
        for number in range(_SAMPLES + _STEPS):
            rows.append(np.vstack([moved, -K @ moved]))
            moved = (loop if number < _SAMPLES else longer) @ moved
        #: States and inputs after each number of samples, as a linear function of z - z_t.
        self._rows = np.array(rows)

    def contains(self, z: np.ndarray, target: Target) -> bool:
        """Return whether the linear loop from z keeps 0.9 of the distances from target to limits.

        z: followed states, (n,)
        """
        k = len(self.K.T)
        zs, vs = self._scaled.state_limits, self._scaled.input_limits
        below, above = (
            _WITHIN * np.concatenate([z_limit[:k] - target.z[:k], v_limit - target.v])
            for z_limit, v_limit in zip(zs, vs, strict=True)
        )
        moved = self._rows @ (z - target.z)[:k]
        most = np.maximum(above, _LEAST)
        least = np.minimum(below, -_LEAST)
        return bool(((moved <= most) & (moved >= least)).all())

    def inputs(self, z: np.ndarray, target: Target) -> np.ndarray:
        """Return the inputs v, (m,), within their limits."""
        k = len(self.K.T)
        v = target.v - self.K @ (z - target.z)[:k]
        return np.clip(v, *self._scaled.input_limits)
