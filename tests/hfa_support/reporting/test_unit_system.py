"""Units: the factors are those of the definitions, names follow, and nothing changes unless it is
asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hfa_model
from hfa.units_of_data import in_si
from hfa_support import Model, Report, Signal, shown_in
from hfa_support.reporting.text import shown_unit, shown_value
from hfa_support.reporting.unit_system import english, in_force, si_factor, si_unit, unit_in_force

#: A pound of 0.45359237 kg weighs 1 lbf at 9.80665 m/s².
FOOT, FORCE = 0.3048, 0.45359237 * 9.80665


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
def test_a_unit_and_its_size(unit: str, si: str, factor: float) -> None:
    assert (si_unit(unit), si_factor(unit)) == (si, pytest.approx(factor, rel=1e-15))
    assert si_factor(si) == 1.0
    assert english(english(2.0, unit, unit) * si_factor(unit), si, unit) == pytest.approx(
        2.0, rel=1e-15
    )


def test_only_where_it_is_asked_for() -> None:
    assert (in_force(68.0, "ft/s"), unit_in_force("ft/s"), shown_value(68.0, "ft/s")) == (
        68.0,
        "ft/s",
        "68",
    )
    with shown_in("si"):
        assert (in_force(68.0, "ft/s"), unit_in_force("ft/s")) == (68.0 * FOOT, "m/s")
        assert (shown_value(68.0, "ft/s"), shown_unit("ft/s"), shown_unit("rad/s")) == (
            "20.7264",
            "m/s",
            "deg/s",
        )
    assert shown_unit("ft/s") == "ft/s"
    with pytest.raises(ValueError, match="use one of english, si"), shown_in("metric"):
        pass
    with pytest.raises(ValueError, match="is in km/h, not in ft/s or m/s"):
        english(1.0, "km/h", "ft/s")


# Numbers of a report, by their declared units: lists of units, names of quantities.


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("output_offsets", [2.0, 3.0], [2.0 * FOOT, 3.0]),
        ("C", [[2.0, 3.0], [4.0, 5.0]], [[2.0, 3.0 * FOOT], [4.0 / FOOT, 5.0]]),
        ("P", [[2.0, 3.0], [4.0, 5.0]], [[2.0 / FOOT**2, 3.0 / FOOT], [4.0 / FOOT, 5.0]]),
        ("K", [[2.0, 3.0]], [[2.0 * FORCE / FOOT, 3.0 * FORCE]]),
    ],
)
def test_arrays_by_the_lists_of_units_beside_them(name: str, value: Any, expected: Any) -> None:
    beside = {
        "state_units": ["ft/s", "rad"],
        "input_units": ["lbf"],
        "output_units": ["ft/s", "rad"],
    }
    with shown_in("si"):
        found = in_si(Report("", (), data={**beside, name: value}), hfa_model.aircraft()).data
    np.testing.assert_allclose(found[name], expected, rtol=1e-12)
    assert found["state_units"] == ["m/s", "rad"]


def test_arrays_and_names_of_another_model_have_its_units() -> None:
    model = Model(
        "cart",
        {"place": Signal("m"), "speed": Signal("ft/s")},
        {"force": Signal("lbf")},
        lambda x, u, p, w: ({"place": x.speed, "speed": u.force}, {}),
    )
    data = {
        "operating_states": [[2.0, 3.0]],
        "operating_inputs": [[4.0]],
        "residuals": {"place": 5.0, "speed": 6.0},
    }
    with shown_in("si"):
        found = in_si(Report("", (), data=data), model).data
    np.testing.assert_allclose(found["operating_states"], [[2.0, 3.0 * FOOT]])
    np.testing.assert_allclose(found["operating_inputs"], [[4.0 * FORCE]])
    assert found["residuals"] == {"place": 5.0, "speed": pytest.approx(6.0 * FOOT)}
