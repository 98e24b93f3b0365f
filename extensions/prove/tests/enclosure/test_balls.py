"""Balls contain their members, and their precision is set wherever they are imported."""

import math

from flint import arb
from proofs import FLOAT

from hfa_prove.check.trims import SteadyFlight
from hfa_prove.statements.schedule import Flight


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
