"""Balls contain their members, and their precision is set wherever they are imported."""

import subprocess
import sys

import pytest
from flint import arb

from hfa_prove.enclosure.balls import exact, symmetric
from hfa_prove.enclosure.precision import PRECISION


def test_balls_contain_their_members():
    """Symmetric balls contain both signs of a number, and a double is exact."""
    for value in (arb(-2, 1), -3, 3.0):
        assert symmetric(value).contains(3)
        assert symmetric(value).contains(-3)
        assert not symmetric(value).contains(3.001)
    assert exact(0.1).rad() == 0


@pytest.mark.slow
@pytest.mark.parametrize("module", ["hfa_prove.enclosure.balls", "hfa_prove.search.schedule"])
def test_importing_balls_sets_their_precision(module):
    """Whoever imports balls in a new process computes with the bits of proofs."""
    program = f"import {module}, flint; print(flint.ctx.prec)"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) == PRECISION
