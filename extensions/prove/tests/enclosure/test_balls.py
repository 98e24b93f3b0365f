"""Comparisons of balls, which are true only if proved."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("hfa_prove")

from flint import arb

from hfa_prove.enclosure.balls import (
    doubles,
    exact,
    is_positive_definite,
    matrix,
    symmetric,
)
from hfa_prove.enclosure.precision import PRECISION


@pytest.mark.parametrize(("off", "radius"), [(1.0, 0.5), (1.9, 0.2), (2.0, 0.0), (3.0, 0.0)])
def test_a_matrix_is_definite_if_all_of_its_members_are(off: float, radius: float) -> None:
    """[[2, a], [a, 2]] is positive definite for |a| < 2, also in the lower triangle alone."""
    values = matrix([[2.0, 9.0], [off, 2.0]])
    values[1, 0] += arb(0, radius)
    assert is_positive_definite(values) == (off + radius < 2.0)
    assert not is_positive_definite(matrix([[-2.0, 0.0], [0.0, 2.0]]))


def test_balls_contain_their_members() -> None:
    """Symmetric balls contain both signs of a number, and doubles are exact."""
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
