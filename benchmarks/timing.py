"""Two things timed in turn, so that a machine whose speed drifts is fair to both."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any, NamedTuple


class Comparison(NamedTuple):
    """Medians over the repeats, seconds for one unit of work, and the median of the ratios pair by pair."""

    ours: float
    peer: float
    ratio: float

    @classmethod
    def of(cls, ours: list[float], peer: list[float]) -> Comparison:
        """From times measured in turn. ratio: peer / ours, how many times faster ours is."""
        ratios = [b / a for a, b in zip(ours, peer, strict=True)]
        return cls(statistics.median(ours), statistics.median(peer), statistics.median(ratios))


def in_turn(
    ours: Callable[[], Any], peer: Callable[[], Any], *, units: float = 1.0, peer_units: float = 1.0, repeats: int = 7
) -> Comparison:
    """Ours, peer, ours, peer, ... after one uncounted round. units: pieces of work in one call of each."""
    ours()
    peer()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for function, size, row in ((ours, units, times[0]), (peer, peer_units, times[1])):
            start = time.perf_counter()
            function()
            row.append((time.perf_counter() - start) / size)
    return Comparison.of(*times)
