"""What a sweep says on a terminal: every eigenvalue, in the column of its mode, and what to know before trusting it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from hfa_model import Aircraft
from trim import Sweep, sweep

NUMBER = re.compile(r"(-?\d+\.\d{4})(?: ± (\d+\.\d{4})i)?")


def eigenvalues_in(line: str) -> list[complex]:
    """The eigenvalues of a line of the table, a pair as two."""
    found = []
    for real, imaginary in NUMBER.findall(line):
        value = complex(float(real), float(imaginary or 0))
        found += [value, value.conjugate()] if imaginary else [value]
    return found


@pytest.fixture(scope="module")
def result(published_aircraft: Aircraft) -> Sweep:
    return sweep(published_aircraft, {"dihedral": np.radians(np.arange(0.0, 60.1, 5.0))})


def test_every_eigenvalue_of_every_point_is_shown(result: Sweep) -> None:
    """Beyond 28 deg the pair of the short period becomes two real eigenvalues."""
    lines = result.report().text().splitlines()[3:]
    assert np.count_nonzero(result.eigenvalues[result.trimmed].imag == 0, axis=1).max() == 4
    for line, expected, trimmed in zip(lines, result.eigenvalues, result.trimmed, strict=False):
        if trimmed:
            found = np.sort_complex(eigenvalues_in(line))
            np.testing.assert_allclose(found, np.sort_complex(expected.round(4)), atol=1.1e-4)


def test_two_real_eigenvalues_stand_in_the_column_of_their_pair(result: Sweep) -> None:
    lines = result.report().text().splitlines()
    assert re.split(r" {2,}", lines[2])[1] == "short period 1/s"
    at_30 = next(line for line in lines if line.startswith("30 "))
    assert re.split(r" {2,}", at_30)[1] == "-4.5424, -2.9511"
    at_15 = next(line for line in lines if line.startswith("15 "))
    assert re.split(r" {2,}", at_15)[1] == "-4.4603 ± 6.0160i"


def test_a_point_without_a_trim_has_a_dash_for_each_mode(result: Sweep) -> None:
    reasons = ("no trim: why", *result.reasons[1:])
    lines = replace(result, reasons=reasons).report().text().splitlines()
    assert re.split(r" {2,}", lines[3]) == ["0", "-", "-", "-", "-"]
    assert "0: no trim: why" in lines


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        ([0.0, 15.0], []),
        ([-15.0, 15.0], []),
        ([16.0], ["the point lies beyond the paper's range of dihedral, which ends at 15 deg"]),
        ([15.0, 16.0], ["1 of 2 points lies beyond the paper's range of dihedral, which ends at 15 deg"]),
        ([-16.0, 15.0, 16.0], ["2 of 3 points lie beyond the paper's range of dihedral, which ends at 15 deg"]),
    ],
)
def test_a_sweep_warns_beyond_the_papers_range(
    published_aircraft: Aircraft, degrees: list[float], expected: list[str]
) -> None:
    assert sweep(published_aircraft, {"dihedral": np.radians(degrees)}).warnings == expected


def test_a_sweep_without_dihedral_warns_of_nothing(published_aircraft: Aircraft) -> None:
    assert sweep(published_aircraft, {"speed": [66.0, 70.0]}).warnings == []
