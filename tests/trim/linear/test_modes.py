"""Modes and handling qualities, compared with closed forms, printed values and nonlinear trims."""

import math

import numpy as np
import pytest

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
