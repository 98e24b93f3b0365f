"""Modes and handling qualities, compared with closed forms, printed values and nonlinear trims."""

import math

import numpy as np
import pytest
from own_models import NAVION, trimmed

import hfa
from trim import modes_of


@pytest.mark.parametrize("damping", [0.7, -0.2])
def test_an_oscillator_has_its_textbook_numbers(damping):
    """The mode of x'' + 2 ζ ω x' + ω² x = 0 with ω = 3 rad/s agrees with the textbook formulas."""
    (mode,) = modes_of(
        np.array([[0.0, 1.0], [-9.0, -6.0 * damping]]),
        ("alpha", "pitch_rate"),
        hfa.aircraft().modes,
    )
    assert mode.frequency == pytest.approx(3.0, rel=1e-14)
    assert mode.damping == pytest.approx(damping, rel=1e-13)
    assert mode.period == pytest.approx(2 * math.pi / (3 * math.sqrt(1 - damping**2)), rel=1e-13)
    time = math.log(2) / (3 * abs(damping))
    halves, doubles = (time, math.inf) if damping > 0 else (math.inf, time)
    assert (mode.time_to_half, mode.time_to_double) == pytest.approx((halves, doubles), rel=1e-13)
    assert mode.stable == (damping > 0)
    assert mode.eigenvalue.imag > 0
    assert mode.name == "short period"


@pytest.mark.parametrize(
    "block",
    [
        np.diag([-3.0, -1.0, 0.0]),
        np.array([[-3.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]),
    ],
    ids=["integrator", "double integrator"],
)
@pytest.mark.parametrize("seed", range(2))
def test_an_eigenvalue_zero_by_rounding_is_zero(block, seed):
    """A = T block T⁻¹ with a random T has the eigenvalues 0 of the block only up to rounding: the modes
    have the eigenvalue 0 exactly, and no time to half or to double.
    """
    basis = np.random.default_rng(seed).normal(size=(3, 3))
    A = basis @ block @ np.linalg.inv(basis)
    modes = modes_of(A, ("a", "b", "c"))
    zero = [mode for mode in modes if mode.eigenvalue == 0]
    assert len(zero) == np.count_nonzero(np.diag(block) == 0)
    for mode in zero:
        assert (mode.damping, mode.frequency, mode.stable) == (0.0, 0.0, False)
        assert math.isinf(mode.time_to_half)
        assert math.isinf(mode.time_to_double)


# Handling qualities.


def values(point):
    """Return the handling qualities on the sheet, name -> value."""
    (group,) = (each for each in point.sheet.groups if each.title == "modes and levels")
    return {row.name: row.value for row in group.rows if "eigenvalue" not in row.name}


def test_handling_qualities_follow_from_the_modes():
    """Frequencies, dampings, time constants and times of the sheet are those of the eigenvalues.

    n/alpha and CAP are computed by hand in test_sheet.py.
    """
    point = trimmed(NAVION)
    qualities = values(point)
    roots = {mode.name: mode.eigenvalue for mode in point.modes}
    for name in ("short period", "phugoid", "dutch roll"):
        assert qualities[f"{name} frequency"] == pytest.approx(abs(roots[name]), rel=1e-12)
        assert qualities[f"{name} damping"] == pytest.approx(
            -roots[name].real / abs(roots[name]), rel=1e-12
        )
    damped = qualities["dutch roll damping"] * qualities["dutch roll frequency"]
    assert qualities["dutch roll damping times frequency"] == pytest.approx(damped)
    assert len(qualities) == 12  # with n/alpha, CAP and phi/beta
    assert qualities["roll time constant"] == pytest.approx(-1 / roots["roll"].real, rel=1e-12)
    assert qualities["spiral time to half"] == pytest.approx(
        -math.log(2) / roots["spiral"].real, rel=1e-12
    )
