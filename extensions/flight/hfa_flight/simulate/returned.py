"""The rule whether a flight has returned to its trim, of `fly`, `optimize` and `assess`."""

from __future__ import annotations

import numpy as np

from hfa_aircraft.batch_simulation import has_decayed
from hfa_aircraft.model import Model
from hfa_support.matrices import quadratic_forms

#: Largest cost-to-go z'Pz at the end of a flight that has returned, relative to its whole cost, the
#: cost flown and the cost-to-go.
TOLERANCE = 0.05
#: Deviations in nominal values at which the aircraft is at its trim, whatever the cost.
_AT_TRIM = 1e-9
RULE = (
    "A flight has returned to the trim if its linear cost-to-go z'Pz at the end is at most "
    f"{100 * TOLERANCE:g} % of its cost."
)


def has_returned(model: Model, z: np.ndarray, P: np.ndarray, spent: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the flights that have returned to the trim at their end.

        z'Pz <= TOLERANCE (spent + z'Pz), or |z| <= 1e-9 nominal values in every state

    model: the aircraft
    z: deviations of the linear states at the end, (N, k)
    P: cost of the linear optimum, (k, k)
    spent: cost up to the end, (N,)
    """
    nominal = model.nominal(model.linear)
    with np.errstate(over="ignore", invalid="ignore"):  # a flight may diverge
        to_go = quadratic_forms(z, P)
        decayed = has_decayed(to_go, spent + to_go, TOLERANCE)
    return np.asarray(decayed | (np.abs(z) <= _AT_TRIM * nominal).all(axis=1))
