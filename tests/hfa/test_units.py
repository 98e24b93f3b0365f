"""The option --units si: units are converted, and physical laws are satisfied."""

import numpy as np
import pytest
from cli import answer, hfa

FOOT = 0.3048
TRIM = ("trim", "--dihedral", "12")


def test_trims_in_si_satisfy_physical_laws():
    """A trim in SI units satisfies four laws with the numbers of the standard air within 1e-4."""
    data = answer(*TRIM, "--units", "si")
    performance = {name: row["value"] for name, row in data["sheet"].items()}
    speed = data["operating_point"]["states"]["speed"]
    # The density of the standard atmosphere at 40,000 ft is 0.30267 kg/m^3, its speed of sound
    # 295.07 m/s.
    pressure = 0.5 * 0.302_67 * speed**2
    coefficient = performance["lift"] / (pressure * performance["S"])
    weight = 3 * 9.326 * 14.5939029 * 32.2 * FOOT
    assert performance["dynamic pressure"] == pytest.approx(pressure, rel=1e-4)
    assert performance["lift coefficient"] == pytest.approx(coefficient, rel=1e-4)
    assert performance["mach"] == pytest.approx(speed / 295.07, rel=1e-4)
    assert performance["weight"] == pytest.approx(weight, rel=1e-4)


def test_matrices_in_si_are_similar():
    """In SI units A becomes T A T⁻¹, where T converts the states. B to F are converted likewise."""
    words = ("linearize", "--dihedral", "12", "--outputs", "vertical_acceleration,alpha")
    before = answer(*words)
    after = answer(*words, "--units", "si")
    T = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["state_units"]])
    Y = np.diag([FOOT if unit.startswith("ft") else 1.0 for unit in before["output_units"]])
    inverse = np.linalg.inv(T)
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
    assert after["state_offsets"][0] == pytest.approx(68 * FOOT, rel=1e-15)


@pytest.mark.parametrize("suffix", ["json", pytest.param("mat", marks=pytest.mark.slow)])
def test_plants_in_si_are_read(tmp_path, suffix):
    """A plant written in SI units names them when it is read."""
    plant = str(tmp_path / f"plant.{suffix}")
    assert hfa("linearize", "--dihedral", "12", "--units", "si", "-o", plant).code == 0
    found = answer("solve", "--model", plant)
    assert (found["states"][0], found["state_units"][:2]) == ("speed", ["m/s", "rad"])
