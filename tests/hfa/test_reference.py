"""The option --reference of the commands."""

import pytest
from cli import answer
from game_files import AT_15


def test_a_reference_needs_the_same_elevator_in_si_units():
    """The center elevator that a commanded dihedral needs does not depend on the units."""
    si = answer("solve", *AT_15, "--units", "si", "--reference", "dihedral=28.65")["tracking"]
    english = answer("solve", *AT_15, "--reference", "dihedral=28.65")["tracking"]
    assert si["trims"][0]["needed"]["elevator_center"] == pytest.approx(
        english["trims"][0]["needed"]["elevator_center"], rel=1e-6
    )
