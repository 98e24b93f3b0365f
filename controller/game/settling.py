"""Settling time of a series."""

from __future__ import annotations

import numpy as np


def settled_at(times: np.ndarray, sizes: np.ndarray, limit: float) -> float:
    """First time from which sizes (N,) stay within the limit to the end, s, or inf when the last
    one does not."""
    above = np.flatnonzero(~(sizes <= limit))
    first = int(above[-1]) + 1 if len(above) else 0
    return float(times[first]) if first < len(times) else np.inf
