"""Comparison of computations in several threads of one process with those in a single thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

from numpy.typing import NDArray

Rows = Mapping[str, NDArray]


def differing(chunk: Callable[[int], Rows], numbers: Sequence[int]) -> list[int]:
    """Return the numbers of the chunks whose results with four threads differ from those with one.

    chunk: function from the number of a chunk to its arrays by name
    """
    alone = [chunk(number) for number in numbers]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(chunk, numbers))
    same = [
        {name: a[name].tobytes() == b[name].tobytes() for name in a}
        for a, b in zip(alone, together, strict=True)
    ]
    return [number for number, names in zip(numbers, same, strict=True) if not all(names.values())]
