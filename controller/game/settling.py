"""Settling time of a time series."""

from __future__ import annotations

import numpy as np


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """Return the settling time, the first of the times from which all sizes stay at or below a
    limit.

    The result is inf if the last size exceeds the limit or is NaN.

    times: (N,), increasing
    sizes: (N,), magnitude of the signal at each time
    limit: limit of the sizes
    """
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else np.inf
