"""Sweeps computed by several threads of one process equal those of a single thread bit by bit."""

from __future__ import annotations

import numpy as np
from threads import Rows, differing

import hfa


def test_concurrent_sweeps_equal_sequential_sweeps() -> None:
    """Three sweeps computed in concurrent threads equal those computed one after the other."""

    def chunk(number: int) -> Rows:
        rng = np.random.default_rng(number)
        angles, speeds = np.radians(rng.uniform(0.0, 20.0, 8)), rng.uniform(25.0, 75.0, 6)
        found = hfa.sweep(hfa.aircraft(), {"dihedral": np.sort(angles), "speed": np.sort(speeds)})
        return {
            name: getattr(found, name) for name in ("states", "inputs", "A", "B", "eigenvalues")
        }

    assert differing(chunk, range(3)) == []
