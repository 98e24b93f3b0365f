"""Innovations of a Kalman filter."""

import numpy as np


def innovations_of(known):
    """Return the standard deviations of the innovations y - C x of a Kalman filter, (p,)."""
    return np.sqrt(np.diag(known.C @ known.P @ known.C.T + known.R))
