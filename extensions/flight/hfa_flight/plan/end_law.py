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
        transition = np.eye(k)  # from z to the states after some samples
        states_and_inputs = []
        for number in range(_SAMPLES + _STEPS):
            states_and_inputs.append(np.vstack([transition, -K @ transition]))
            transition = (loop if number < _SAMPLES else longer) @ transition
        #: Matrices from z to the states and inputs after the checked numbers of samples.
        self._states_and_inputs = np.array(states_and_inputs)

    def contains(self, z: np.ndarray) -> bool:
        """Return whether the linear loop from z stays within `_WITHIN` of all limits.

        z: followed states, (n,)
        """
        k = len(self.K.T)
        (lowest_z, highest_z), (lowest_v, highest_v) = (
            self._scaled.state_limits,
            self._scaled.input_limits,
        )
        lowest = _WITHIN * np.concatenate([lowest_z[:k], lowest_v])
        highest = _WITHIN * np.concatenate([highest_z[:k], highest_v])
        flown = self._states_and_inputs @ z[:k]
        return bool(((flown <= highest) & (flown >= lowest)).all())

    def inputs(self, z: np.ndarray) -> np.ndarray:
        """Return the inputs v, (m,), within their limits."""
        return np.clip(-self.K @ z[: len(self.K.T)], *self._scaled.input_limits)
