"""What a schedule says of its points: certified ones, and those of a file, of which less is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from controller.policy.scheduled import Schedule
from hfa_support import BadInputError
from hfa_support.reporting.text import Table
from trim import OperatingPoint
from verification.flights.scheduling import CertifiedSchedule, GridPoint


def test_each_point_says_what_is_known_of_it(point: OperatingPoint) -> None:
    states = [point.states._replace(dihedral=float(np.radians(degrees))) for degrees in (5.0, 10.0, 15.0)]
    K, points = np.zeros((5, 6)), [replace(point, states=each) for each in states]
    grid = (
        GridPoint(points[0], K, -0.1),
        GridPoint(points[1], K, -0.2, 0.0, -0.3, 12),
        GridPoint(points[2], K, -0.4, 2e-9),
    )
    made = CertifiedSchedule(
        Schedule(np.radians([5.0, 15.0]), np.zeros((2, 7)), np.zeros((2, 5)), np.zeros((2, 5, 6))), grid, -0.05
    )
    (table,) = [each for each in made.block().parts if isinstance(each, Table)]
    assert [tuple(row) for row in table.rows] == [
        ("5", "-0.1000", "-", "-", "-"),
        ("10", "-0.2000", "-0.3000", "0", "12 hold"),
        ("15", "-0.4000", "-", "2.0e-09", "-"),
    ]
    assert made.at(float(np.radians(10.0))).certificates == 12
    with pytest.raises(BadInputError, match="no grid point at 7 deg"):
        made.at(float(np.radians(7.0)))
