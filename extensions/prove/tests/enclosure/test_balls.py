"""Comparisons of balls, which are true only if proved."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip("hfa_prove")

from flint import arb

from hfa_prove.enclosure.balls import (
    doubles,
    exact,
    hull,
    is_positive_definite,
    matrix,
    norm,
    pivots,
    symmetric,
)
from hfa_prove.enclosure.precision import PRECISION


@pytest.mark.parametrize(("off", "second"), [(1.0, 1.5), (2.0, 0.0), (3.0, -2.5)])
def test_pivots_equal_those_of_gaussian_elimination(off: float, second: float) -> None:
    """Pivots are those of Gaussian elimination, and a matrix is definite if all are positive.

    If a pivot is 0, None is returned.
    """
    found = pivots(matrix([[2.0, off], [off, 2.0]]))
    assert (found is None) == (second == 0.0)
    assert is_positive_definite(matrix([[2.0, off], [off, 2.0]])) == (second > 0.0)
    assert found is None or [float(each) for each in found] == [2.0, second]


def test_norms_and_hulls_contain_every_member() -> None:
    """A norm contains the norms of all matrices of the balls, and no other far from them."""
    found = norm([arb(3, 1), arb(-4, 1), arb(0, 2)])
    assert float(found.lower()) == pytest.approx(np.sqrt(4.0 + 9.0), rel=1e-7)
    assert float(found.upper()) == pytest.approx(np.sqrt(16.0 + 25.0 + 4.0), rel=1e-7)
    assert found.contains(arb(13).sqrt())
    assert found.contains(arb(45).sqrt())
    assert norm([]) == 0
    (ball,) = hull(np.array([[-1.5]]), np.array([[0.25]])).entries()
    assert (float(ball.lower()), float(ball.upper())) == (pytest.approx(-1.5), pytest.approx(0.25))
    assert ball.contains(-1.5)
    assert ball.contains(0.25)
    for value in (arb(-2, 1), -3, 3.0):
        assert symmetric(value).contains(3)
        assert symmetric(value).contains(-3)
        assert not symmetric(value).contains(3.001)
    assert exact(0.1).rad() == 0
    assert doubles(matrix([[1.0, 2.0], [3.0, 4.0]])).tolist() == [[1.0, 2.0], [3.0, 4.0]]


@pytest.mark.slow
@pytest.mark.parametrize("module", ["hfa_prove.enclosure.balls", "hfa_prove.search.schedule"])
def test_importing_balls_sets_their_precision(module: str) -> None:
    """Whoever imports balls in a new process computes with the bits of proofs."""
    program = f"import {module}, flint; print(flint.ctx.prec)"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) == PRECISION
