"""Units: the factors are those of the definitions, names follow, and nothing changes unless it is asked for."""

from __future__ import annotations

import pytest

from hfa_support import shown_in
from hfa_support.reporting.text import shown_unit, shown_value
from hfa_support.reporting.unit_system import english, in_force, si_factor, si_unit, unit_in_force

FOOT, POUND, GRAVITY = 0.3048, 0.45359237, 9.80665


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("1", "1", 1.0),
        ("", "", 1.0),
        ("rad/s", "rad/s", 1.0),
        ("ft/s^2", "m/s^2", FOOT),
        ("ft^2", "m^2", FOOT**2),
        ("lbf", "N", POUND * GRAVITY),
        ("slug", "kg", POUND * GRAVITY / FOOT),
        ("slug/ft^3", "kg/m^3", POUND * GRAVITY / FOOT**4),
        ("lbf/ft^2", "N/m^2", POUND * GRAVITY / FOOT**2),
        ("ft lbf", "N m", POUND * GRAVITY * FOOT),
        ("ft lbf s/rad", "N m s/rad", POUND * GRAVITY * FOOT),
        ("(rad/s)/(ft/s)", "(rad/s)/(m/s)", 1 / FOOT),
        ("(ft/s^2)/(rad)", "(m/s^2)/(rad)", FOOT),
        ("1/((ft/s) (ft/s))", "1/((m/s) (m/s))", FOOT**-2),
    ],
)
def test_a_unit_and_its_size(unit: str, si: str, factor: float) -> None:
    assert (si_unit(unit), si_factor(unit)) == (si, pytest.approx(factor, rel=1e-15))
    assert si_factor(si) == 1.0
    assert english(english(2.0, unit, unit) * si_factor(unit), si, unit) == pytest.approx(2.0, rel=1e-15)


def test_only_where_it_is_asked_for() -> None:
    assert (in_force(68.0, "ft/s"), unit_in_force("ft/s"), shown_value(68.0, "ft/s")) == (68.0, "ft/s", "68")
    with shown_in("si"):
        assert (in_force(68.0, "ft/s"), unit_in_force("ft/s")) == (68.0 * FOOT, "m/s")
        assert (shown_value(68.0, "ft/s"), shown_unit("ft/s"), shown_unit("rad/s")) == ("20.7264", "m/s", "deg/s")
    assert shown_unit("ft/s") == "ft/s"
    with pytest.raises(ValueError, match="use one of english, si"), shown_in("metric"):
        pass
    with pytest.raises(ValueError, match="is in km/h, not in ft/s or m/s"):
        english(1.0, "km/h", "ft/s")
