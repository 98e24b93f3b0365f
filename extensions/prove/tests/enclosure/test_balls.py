"""Balls contain their members, and their precision is set wherever they are imported."""

import math
import subprocess
import sys

import pytest
from flint import arb
from proofs import FLOAT

from hfa_prove.check.trims import SteadyFlight
from hfa_prove.enclosure.ball_function import about_zero, exact
from hfa_prove.enclosure.precision import PRECISION
from hfa_prove.statements.schedule import Flight


def test_balls_contain_their_members():
    """Symmetric balls contain both signs of a number, and a double is exact."""
    for value in (arb(-2, 1), -3, 3.0):
        assert about_zero(value).contains(3)
        assert about_zero(value).contains(-3)
        assert not about_zero(value).contains(3.001)
    assert exact(0.1).rad() == 0


def test_a_read_number_contains_its_decimal():
    """The ball of a parameter, here the drag, contains the exact number that a user wrote: a decimal, or
    a decimal number of degrees in rad. The parameter is the double nearest to it.
    """
    given = [("0.1", arb("0.1"), 0.1)]  # text, exact number, nearest double
    for hundredths in range(1, 2000, 10):
        text = f"{hundredths / 100:.2f}"
        given.append((text, arb(text) * arb.pi() / 180, math.radians(float(text))))
    outside = []
    for text, exactly, nearest in given:
        flight = Flight(
            FLOAT,
            parameters={"pull": 1.0, "drag": nearest},
            imposed={"depth": 1.0, "heave": 0.0},
            limits={},
            range=(1.0, 2.0),
            first={"lift": 1.0},
        )
        # imposed values, parameters and the unit of the scheduling variable
        *_, drag, _ = SteadyFlight(flight).constants
        if not drag.contains(exactly):
            outside.append(text)
    assert outside == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "module", ["hfa_prove.enclosure.ball_function", "hfa_prove.search.schedule"]
)
def test_importing_balls_sets_their_precision(module):
    """A new process that imports balls computes with the bits of proofs."""
    program = f"import {module}, flint; print(flint.ctx.prec)"
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=60)
    assert int(done.stdout) == PRECISION
