"""Conversion of English units to SI units."""

from __future__ import annotations

import math

import pytest

from hfa_support.units import conversion, si_factor, si_unit

FOOT = 0.3048
FORCE = 0.45359237 * 9.80665


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("1", "1", 1.0),
        ("", "", 1.0),
        ("rad/s", "rad/s", 1.0),
        ("ft/s^2", "m/s^2", FOOT),
        ("ft^2", "m^2", FOOT**2),
        ("lbf", "N", FORCE),
        ("slug", "kg", FORCE / FOOT),
        ("slug/ft^3", "kg/m^3", FORCE / FOOT**4),
        ("lbf/ft^2", "N/m^2", FORCE / FOOT**2),
        ("ft lbf", "N m", FORCE * FOOT),
        ("ft lbf s/rad", "N m s/rad", FORCE * FOOT),
        ("(rad/s)/(ft/s)", "(rad/s)/(m/s)", 1 / FOOT),
        ("(ft/s^2)/(rad)", "(m/s^2)/(rad)", FOOT),
        ("1/((ft/s) (ft/s))", "1/((m/s) (m/s))", FOOT**-2),
    ],
)
def test_units_have_their_conversion_factors(unit: str, si: str, factor: float) -> None:
    """Each unit has the stated SI unit and conversion factor, in both directions."""
    assert si_unit(unit) == si
    assert si_factor(unit) == pytest.approx(factor, rel=1e-15)
    assert si_factor(si) == 1.0
    assert conversion(unit, si) == pytest.approx(factor, rel=1e-15)
    assert conversion(si, unit) == pytest.approx(1 / factor, rel=1e-15)


@pytest.mark.parametrize(
    ("stated", "unit", "factor"),
    [
        ("km/h", "ft/s", 1.0 / 3.6 / FOOT),
        ("kt", "m/s", 1852.0 / 3600.0),
        ("deg/s", "rad/s", math.pi / 180.0),
        ("1/deg", "1/rad", 180.0 / math.pi),
        ("m/s²", "ft/s^2", 1.0 / FOOT),
        ("us", "s", 1e-6),
        ("slug ft^2", "N m s^2", FORCE * FOOT),
    ],
)
def test_usual_units_are_converted(stated: str, unit: str, factor: float) -> None:
    """Units of the same quantity are converted, whatever their spelling."""
    assert conversion(stated, unit) == pytest.approx(factor, rel=1e-12)
