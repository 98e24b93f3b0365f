"""The first lines of trims and linear models state the condition, unstable modes and controls."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from cli import hfa as command
from project import ROOT

import hfa
from hfa import Signal
from trim import release
from trim.point.condition import usual_condition


def first_lines(aircraft: str, **hold: float) -> tuple[hfa.OperatingPoint, list[str]]:
    """Return the trim of an aircraft with held values, and the lines of its report."""
    model = hfa.load_model(f"{ROOT}/examples/{aircraft}")
    condition = release(usual_condition(model), hold=hold)
    point = hfa.trim(model, condition)
    return point, point.report().text().splitlines()


@pytest.mark.parametrize("aircraft", ["uav.toml", "gtm.py:GTM", "f16.py:F16"])
def test_the_first_line_states_speed_path_and_stability(aircraft: str) -> None:
    """The first line has the trimmed speed and the flight path, and "none" for a stable aircraft."""
    point, lines = first_lines(aircraft)
    unit = point.model.unit("speed")
    assert lines[0].startswith(f"{point.model.subject} trimmed: level, ")
    assert f"{point['speed']:.5g} {unit}" in lines[0]
    linear = point.linearize()
    assert lines[0].endswith("unstable: none") == linear.is_stable
    for mode in linear.modes:
        assert (f"{mode.name} (2x in" in lines[0]) == math.isfinite(mode.time_to_double)


def test_a_climb_is_named_with_its_angle() -> None:
    """A climb of 2 deg and a descent of 3 deg stand in the first line."""
    _, climbing = first_lines("gtm.py:GTM", gamma=math.radians(2.0))
    _, sinking = first_lines("gtm.py:GTM", gamma=math.radians(-3.0))
    assert (": climb 2 deg," in climbing[0], ": descent 3 deg," in sinking[0]) == (True, True)


def test_the_second_line_states_controls_of_their_limits() -> None:
    """The second line has alpha and each moved input, with the limits of its signal."""
    point, lines = first_lines("gtm.py:GTM")
    numbers = re.findall(r"-?\d+\.?\d*", lines[1])
    low, high = point.model.limits["elevator"]
    expected = np.degrees([point["alpha"], point["elevator"], low, high]).tolist()
    expected += [point["throttle"], 100.0]
    np.testing.assert_allclose([float(number) for number in numbers], expected, rtol=5e-3)
    inputs = {
        "a": Signal("N", min=-3.0, max=3.0),
        "b": Signal("N", min=0.0, max=5.0),
        "c": Signal("N", min=-1.0, max=4.0),
        "d": Signal("N"),
        "idle": Signal("N"),
    }
    box = hfa.Model(
        "box",
        {"x": Signal("m")},
        inputs,
        lambda x, u, p, w: ({"x": sum(u) - 0.5}, {}),
        trim={"x": 0.0, "b": 1.5, "c": 2.0, "d": -1.0, "idle": 0.0},
    )
    second = hfa.trim(box).report().title.splitlines()[1]
    assert second == "a -2 of ±3 N, b 1.5 of 5 N, c 2 of -1 to 4 N, d -1 N"


def test_lift_over_drag_stands_in_the_second_lines() -> None:
    """L/D of the flexible aircraft is lift divided by drag of its loads."""
    point = hfa.trim(hfa.aircraft(), hfa.paper.level_flight(0.2))
    title = point.report().title
    (shown,) = re.findall(r"L/D (\S+)", title)
    assert float(shown) == pytest.approx(point["lift"] / point["drag"], rel=5e-3)
    assert point["drag"] == pytest.approx(point["thrust"] * math.cos(point["alpha"]), rel=1e-9)


def _divergent(x: Any, u: Any, p: Any, w: Any) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    return {"height": 0.1 * x.height + u.force}, {}


def test_an_unstable_mode_is_named_with_its_time_to_double() -> None:
    """A mode with the eigenvalue 0.1 1/s doubles in ln 2 / 0.1 s."""
    states = {"height": Signal("m")}
    model = hfa.Model("balloon", states, {"force": Signal("N")}, _divergent, trim={"height": 1.0})
    point = hfa.trim(model)
    expected = f"unstable: height (2x in {math.log(2.0) / 0.1:.3g} s)"
    for report in (point.report(), point.linearize().report()):
        assert report.title.splitlines()[0].endswith(expected)


def test_first_lines_fit_into_80_columns() -> None:
    """Long names, many inputs and many unstable modes are wrapped."""
    names = [f"a_rather_long_name_of_state_{number}" for number in range(5)]
    inputs = {f"a_rather_long_name_of_input_{number}": Signal("N") for number in range(5)}

    def equations(x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        return {
            name: getattr(x, name) + force - 1.0 for name, force in zip(names, u, strict=True)
        }, {}

    model = hfa.Model("many", dict.fromkeys(names, Signal("m")), inputs, equations)
    point = hfa.trim(model, hfa.TrimCondition(model, dict.fromkeys(names, 3.0)))
    for title in (point.report().title, point.linearize().report().title):
        assert max(map(len, title.splitlines())) <= 80
        assert all(name in title for name in names)


def test_the_unstable_phugoid_at_15_deg_stands_in_the_first_line() -> None:
    """Where the time to double has no room, the name alone stands in the first line."""
    point = hfa.trim(hfa.aircraft(), hfa.paper.level_flight(math.radians(15.0)))
    for title in (point.report().title, point.linearize().report().title):
        assert title.splitlines()[0].endswith("unstable: phugoid")


def test_modes_stand_below_the_first_line_of_a_linear_model() -> None:
    """`linearize` states frequency and damping of each declared mode."""
    model = hfa.load_model(f"{ROOT}/examples/gtm.py:GTM")
    linear = hfa.trim(model).linearize()
    second = linear.report().title.splitlines()[1]
    for mode in linear.modes:
        assert f"{mode.name} {mode.frequency:.3g} rad/s, damping {mode.damping:.3g}" in second


def test_several_angles_are_sent_to_sweep() -> None:
    """`hfa trim --dihedral 8,12` is refused in one line that names `hfa sweep`."""
    result = command("trim", "--dihedral", "8,12")
    assert (result.code, result.err.count("\n")) == (2, 1)
    assert "hfa sweep" in result.err
