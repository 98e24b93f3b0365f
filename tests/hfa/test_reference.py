"""The option --reference of the commands."""

import numpy as np
import pytest
from cli import answer
from game_files import AT_15


def test_a_reference_is_typed_in_degrees():
    """A commanded alpha of 5.73 deg is 5.73 deg in rad in the report on tracking.

    The command of speed, alpha and dihedral together is not a trim.
    """
    command = "speed=7+0.01t+2sin(0.5t),alpha=5.73,dihedral=28.65"
    data = answer("solve", *AT_15, "--reference", command)["tracking"]
    assert data["reachable"] is False
    alone = next(each for each in data["trims"] if list(each["command"]) == ["alpha"])
    assert alone["command"]["alpha"] == pytest.approx(np.radians(5.73))


def test_a_reference_needs_the_same_elevator_in_si_units():
    """The center elevator that a commanded dihedral needs does not depend on the units."""
    si = answer("solve", *AT_15, "--units", "si", "--reference", "dihedral=28.65")["tracking"]
    english = answer("solve", *AT_15, "--reference", "dihedral=28.65")["tracking"]
    assert si["trims"][0]["needed"]["elevator_center"] == pytest.approx(
        english["trims"][0]["needed"]["elevator_center"], rel=1e-6
    )
