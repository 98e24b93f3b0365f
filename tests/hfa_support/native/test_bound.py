"""Sweeps computed by several threads of one process equal those of a single thread bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
from threads import Rows, differing

import hfa
from trim.hfa.level_flight import LEVEL_FLIGHT
from trim.sweeps.sweep import run_points


@pytest.mark.parametrize("compile_code", [False, True])
def test_concurrent_sweeps_equal_sequential_sweeps(compile_code: bool) -> None:
    """Five sweeps computed in concurrent threads equal those computed one after the other."""

    def chunk(number: int) -> Rows:
        rng = np.random.default_rng(number)
        values = np.column_stack(
            [np.radians(rng.uniform(0.0, 20.0, 200)), rng.uniform(25.0, 75.0, 200)]
        )
        rows = run_points(
            hfa.aircraft(), ("dihedral", "speed"), values, LEVEL_FLIGHT, None, compile_code
        )
        return {name: rows[name] for name in ("states", "inputs", "A", "B", "eigenvalues")}

    assert differing(chunk, range(5)) == []
