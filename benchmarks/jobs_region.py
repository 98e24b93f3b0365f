"""Time of the proof of a region of attraction of the GTM."""

from __future__ import annotations

import contextlib
import io
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import scipy.linalg
from scipy.linalg.lapack import dpotrf

from benchmarks.report import Comparison, Limit, Row, shortest
from hfa.main import main

#: Goal, s.
_GOAL = 30.0


def _gtm_region(quick: bool) -> list[Row]:
    """Return the comparison of one proof of the GTM's region with its Cholesky factorizations."""
    name = "pendulum.py:VAN_DER_POL" if quick else "gtm.py:GTM"
    aircraft = Path(__file__).parents[1] / "examples" / name
    sizes: list[int] = []
    with _recorded(sizes), contextlib.redirect_stdout(io.StringIO()):
        start = time.perf_counter()
        assert main(["prove", "region", "--aircraft", str(aircraft)]) == 0
        seconds = time.perf_counter() - start
    assert sizes, "the interior point method factors its matrices by another function"
    timing = Comparison(seconds, _GOAL, _GOAL / seconds)
    limit = Limit(_factorizations(sizes), "the factorizations of the interior point method")
    return [Row("proved region of the GTM", "a goal of 30 s", timing, 1.0, limit=limit)]


def _recorded(sizes: list[int]) -> contextlib.AbstractContextManager[Any]:
    """Record the size of each matrix that `cho_factor` factors in the `with` block."""
    factor = scipy.linalg.cho_factor

    def recorded(matrix: np.ndarray, **options: bool) -> Any:
        sizes.append(len(matrix))
        return factor(matrix, **options)

    return patch.object(scipy.linalg, "cho_factor", recorded)


def _factorizations(sizes: list[int]) -> float:
    """Return the total time in which LAPACK factors matrices of given sizes (Cholesky), s."""
    total = 0.0
    for size, count in Counter(sizes).items():
        M = np.eye(size) + 1.0
        total += count * shortest(partial(dpotrf, M, lower=True))
    return total


JOBS = {"gtm_region": _gtm_region}
