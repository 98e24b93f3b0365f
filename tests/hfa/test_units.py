"""The option --units si: units are converted, and physical laws are satisfied."""

import numpy as np
import pytest
from cli import answer

FOOT = 0.3048
TRIM = ("trim", "--dihedral", "12")


def test_matrices_in_si_are_similar():
    """In SI units A is T A T⁻¹, where the diagonal T converts feet of states to metres. B to F are
    converted likewise, with Y of the outputs; inputs have no feet, and disturbances are in ft/s.
    """
    words = ("linearize", "--dihedral", "12", "--outputs", "vertical_acceleration,alpha")
    before = answer(*words)
    after = answer(*words, "--units", "si")
    T = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["state_units"]])
    Y = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["output_units"]])
    inverse = np.linalg.inv(T)  # B and D have 5 inputs, E and F 7 disturbances
    for name, scaling, right in (
        ("A", T, inverse),
        ("A_band", T, inverse),
        ("B", T, np.eye(5)),
        ("C", Y, inverse),
        ("D", Y, np.eye(5)),
        ("E", T, np.eye(7) / FOOT),
        ("F", Y, np.eye(7) / FOOT),
    ):
        expected = scaling @ np.array(before[name]) @ right
        rounding = 1e-13 * np.abs(expected).max()
        np.testing.assert_allclose(after[name], expected, rtol=0, atol=rounding, err_msg=name)
    assert (after["state_units"][0], after["output_units"], after["disturbance_units"]) == (
        "m/s",
        ["m/s^2", "rad"],
        ["m/s"] * 7,
    )
    # The speed of the trim is 68 ft/s.
    assert after["state_offsets"][0] == pytest.approx(68 * FOOT, rel=1e-15)
