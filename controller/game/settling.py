"""Settling time of a time series."""

from __future__ import annotations

import numpy as np


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """Return the first time, s, from which all sizes are at most the limit.

    The result is inf if the last size exceeds the limit or is NaN.

    times: (N,), s
    sizes: (N,)
    """
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else np.inf
