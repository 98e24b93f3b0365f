"""Linear policy at the end of a predictive policy's flight, and where it may take over."""

from __future__ import annotations

import numpy as np

from hfa_flight.plan.hold import Hold
from hfa_flight.plan.scaled import ScaledProblem

#: Fraction of the limits within which the linear loop stays.
_WITHIN = 0.9
#: Numbers of samples of the linear loop that are checked one by one, and of further steps of
#: _LONGER samples each.
_SAMPLES = 150
_STEPS = 100
_LONGER = 10


class EndLaw:
    """Exact held gain v = -K z, where the linear loop keeps all limits.

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
        #: States and inputs after each number of samples, as a linear function of z.
        self._rows = np.array(rows)

    def contains(self, z: np.ndarray) -> bool:
        """Return whether the linear loop from z keeps 0.9 of the distances from trim to limits.

        z: followed states, (n,)
        """
        k = len(self.K.T)
        zs, vs = self._scaled.state_limits, self._scaled.input_limits
        below, above = (
            _WITHIN * np.concatenate([z_limit[:k], v_limit])
            for z_limit, v_limit in zip(zs, vs, strict=True)
        )
        moved = self._rows @ z[:k]
        return bool(((moved <= above) & (moved >= below)).all())

    def inputs(self, z: np.ndarray) -> np.ndarray:
        """Return the inputs v, (m,), within their limits."""
        return np.clip(-self.K @ z[: len(self.K.T)], *self._scaled.input_limits)
