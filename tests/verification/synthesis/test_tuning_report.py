"""What a search says: weights of angles in degrees."""

from __future__ import annotations

import math

import pytest

from verification.synthesis.tuning_report import error_name, shown_error


@pytest.mark.parametrize(
    ("name", "value", "shown"),
    [
        ("dihedral", ("dihedral deg", math.pi), 180.0),
        ("speed", ("speed", 2.0), 2.0),
        ("dihedral_integral", ("dihedral_integral", 3.0), 3.0),
    ],
)
def test_states_that_are_angles_are_shown_in_degrees(name: str, value: tuple[str, float], shown: float) -> None:
    assert (error_name(name), shown_error(value[1], name)) == (value[0], pytest.approx(shown))
