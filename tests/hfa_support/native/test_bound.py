"""Sweeps computed by several threads of one process equal those of a single thread bit by bit."""

from __future__ import annotations

import numpy as np
from threads import Rows, differing

import hfa
from trim.hfa.level_flight import LEVEL_FLIGHT
from trim.sweeps.sweep import run_points


def test_concurrent_sweeps_equal_sequential_sweeps() -> None:
    """Five sweeps computed in concurrent threads equal those computed one after the other."""

    def chunk(number: int) -> Rows:
        rng = np.random.default_rng(number)
        values = np.column_stack(
            [np.radians(rng.uniform(0.0, 20.0, 200)), rng.uniform(25.0, 75.0, 200)]
        )
        rows = run_points(hfa.aircraft(), ("dihedral", "speed"), values, LEVEL_FLIGHT, None)
        return {name: rows[name] for name in ("states", "inputs", "A", "B", "eigenvalues")}

    assert differing(chunk, range(5)) == []
