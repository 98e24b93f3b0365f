"""Innovations of a Kalman filter."""

from __future__ import annotations

import numpy as np

from hfa_flight.policies.kalman import KalmanFilter


def innovations_of(known: KalmanFilter) -> np.ndarray:
    """Return the standard deviations of the innovations y - C x, (p,)."""
    return np.sqrt(np.diag(known.C @ known.P @ known.C.T + known.R))
