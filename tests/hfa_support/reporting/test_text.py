"""Formatting of angles, matrices and tables as text."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hfa.extend import Table
from hfa_support.reporting.text import columns, degrees, in_degrees, matrix_table, shown_value


def test_angles_are_printed_in_degrees() -> None:
    """Angles and angular rates are printed in degrees. Other units are unchanged."""
    angle = math.radians(15.0)
    assert in_degrees(angle) == 15.0
    assert degrees(angle, "rad/s") == ("15.00000", "deg/s")
    assert degrees(68.0, "ft/s") == ("68.00000", "ft/s")
    assert (shown_value(angle, "rad"), shown_value(2.0, "ft", ".2f")) == ("15", "2.00")


@pytest.mark.parametrize(
    ("largest", "cells"),
    [
        (0.0, ("0.0000", "0.0000")),
        (2e-6, ("2.0000e-06", "1.0000e-06")),
        (0.2, ("0.2000", "0.1000")),
        (2e6, ("2000000.0000", "1000000.0000")),
        (2e15, ("2.0000e+15", "1.0000e+15")),
    ],
)
def test_extreme_matrices_are_printed_with_significant_digits(
    largest: float, cells: tuple[str, ...]
) -> None:
    """Very small and very large matrices are printed with significant digits."""
    table = matrix_table("K", ("u1",), ("x1", "x2"), np.array([[largest, largest / 2.0]]))
    assert table.rows == [("u1", *cells)]


def test_wide_tables_are_continued_below() -> None:
    """Columns beyond the width are printed in a block below. The block repeats the first column."""
    header = ("mode", "eigenvalue", "damping")
    rows = [("phugoid", "-69.4807 ± 10.2273i", "0.4125")]
    shown = columns(header, rows, width=30).split("\n\n")
    assert shown == [
        "mode              eigenvalue\nphugoid  -69.4807 ± 10.2273i",
        "mode     damping\nphugoid   0.4125",
    ]
    assert columns(header, rows, width=80).count("\n") == 1
    assert columns(header, rows, width=5).count("-69.4807 ± 10.2273i") == 1


def test_each_block_of_a_wide_table_names_its_rows() -> None:
    """A block repeats every label, so that rows of equal first labels can be told apart."""
    table = Table(
        ("dihedral", "speed", "a", "b"), [("5", "60", "1", "2"), ("5", "70", "3", "4")], 2
    )
    blocks = [block.splitlines() for block in columns(*table, width=19).split("\n\n")]
    assert [block[2].split() for block in blocks] == [["5", "70", "3"], ["5", "70", "4"]]
