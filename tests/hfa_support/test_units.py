"""Units: any product of units has the size of its factors, in every spelling."""

import math

import pytest

from hfa_support.units import (
    ENGLISH_BASES,
    coherent_unit,
    si_unit,
    split_unit,
    stated_factor,
)

POUND, FOOT, GRAVITY = 0.45359237, 0.3048, 9.80665
FORCE, SLUG = POUND * GRAVITY, POUND * GRAVITY / FOOT


@pytest.mark.parametrize(
    ("unit", "in_si", "in_english"),
    [
        ("kt", "m/s", "ft/s"),
        ("deg", "rad", "rad"),
        ("slug ft²", "kg m^2", "slug ft²"),
        ("psf", "N/m^2", "psf"),
        ("kPa", "N/m^2", "lbf/ft^2"),
        ("hp", "W", "lbf ft/s"),
        ("1/deg", "1/rad", "1/rad"),
        ("lbf/(ft/s)", "kg/s", "lbf/(ft/s)"),
        ("slug/ft^3", "kg/m^3", "slug/ft^3"),
        ("lbm/min", "kg/s", "slug/s"),
        ("%", "%", "%"),
        ("rpm/s", "rpm/s", "rpm/s"),
        ("1", "1", "1"),
        ("", "", ""),
        ("kg m^2 rad/s", "kg m^2 rad/s", "slug ft^2 rad/s"),
    ],
)
def test_quantities_have_usual_units(unit, in_si, in_english):
    """A force is in N, a pressure in N/m^2; a moment of inertia has no force; unknown words stay, as do
    units that have this size.
    """
    assert (si_unit(unit), coherent_unit(unit, ENGLISH_BASES)) == (in_si, in_english)


@pytest.mark.parametrize(
    ("stated", "unit", "factor"),
    [
        ("%", "1", 0.01),
        ("%", "chord", 0.01),
        ("%", "m", None),
        ("KT", "m/s", 1852.0 / 3600.0),
        ("lb", "kg", POUND),
        ("lbs", "N", FORCE),
        ("lb/ft^2", "N/m^2", FORCE / FOOT**2),
        ("kg", "m", None),
        ("", "m", None),
        ("rpm", "rpm", 1.0),
        ("", "", 1.0),
        ("ft", "ft", 1.0),
        ("slug ft^2/(s deg)", "kg m^2/(s rad)", SLUG * FOOT**2 * 180.0 / math.pi),
        ("1/(ft min^-1)", "s/m", 60.0 / FOOT),
        ("hp", "N m/s", 550.0 * FOOT * FORCE),
        ("nmi/h^2", "m/s^2", 1852.0 / 3600.0**2),
        ("psi", "Pa", FORCE / 0.0254**2),
        ("degR", "K", 5.0 / 9.0),
    ],
)
def test_units_as_people_write_them(stated, unit, factor):
    """Capitals, pounds of mass or force and percents are understood where they have one meaning."""
    assert stated_factor(stated, unit) == (factor and pytest.approx(factor, rel=1e-12))


def test_a_flight_level_is_a_geopotential_altitude():
    """FL200 is the altitude h with R h / (R + h) = 20,000 ft, of R = 6356.766 km (standard
    atmosphere).
    """
    text, unit = split_unit(" fl200")
    height, radius = float(text), 6356766.0 / FOOT
    assert unit == "ft"
    assert radius * height / (radius + height) == pytest.approx(20_000.0, rel=1e-14)
