"""Sweeps computed by several threads of one process equal those of a single thread bit by bit."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

import hfa


def test_concurrent_sweeps_equal_sequential_sweeps() -> None:
    def swept(number: int) -> list[bytes]:
        rng = np.random.default_rng(number)
        angles, speeds = np.radians(rng.uniform(0.0, 20.0, 8)), rng.uniform(25.0, 75.0, 6)
        found = hfa.sweep(hfa.aircraft(), {"dihedral": np.sort(angles), "speed": np.sort(speeds)})
        return [
            getattr(found, name).tobytes() for name in ("states", "inputs", "A", "B", "eigenvalues")
        ]

    alone = [swept(number) for number in range(3)]
    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(swept, range(3))) == alone
