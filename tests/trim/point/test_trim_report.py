"""A trim's margins: of the inputs, and of every limited variable that the condition leaves free."""

from __future__ import annotations

import re

import numpy as np
import pytest

from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS
from trim.point.condition import LIMITS, TrimCondition, level_flight, release
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from trim.point.trim_report import margins, trim_report

BASE = level_flight(float(np.radians(10.0)))


def solved(aircraft: Aircraft, condition: TrimCondition) -> tuple[TrimCondition, OperatingPoint]:
    return condition, find_operating_point(aircraft, condition)


def test_with_only_inputs_free_there_are_theirs_alone(published_aircraft: Aircraft) -> None:
    condition, point = solved(published_aircraft, BASE)
    assert tuple(margins(condition, point)) == INPUTS
    assert "state                value   unit\n" in trim_report(published_aircraft, condition, point).text()


@pytest.mark.parametrize(
    ("free", "hold"), [("alpha", "aileron_outer"), ("dihedral", "aileron_outer"), ("speed", "aileron_outer")]
)
def test_a_free_state_has_its_distance_to_the_nearer_limit(published_aircraft: Aircraft, free: str, hold: str) -> None:
    known = find_operating_point(published_aircraft, BASE)
    condition, point = solved(published_aircraft, release(BASE, free=(free,), hold={hold: getattr(known.inputs, hold)}))
    found = margins(condition, point)
    value, (lowest, highest) = getattr(point.states, free), LIMITS[free]
    assert found[free] == min(value - lowest, highest - value)
    shown = found[free] if free == "speed" else np.degrees(found[free])
    assert re.search(rf"^{free} .*  {shown:.5f}$", trim_report(published_aircraft, condition, point).text(), re.M)


def test_a_free_flight_path_angle_has_what_pitch_leaves(published_aircraft: Aircraft) -> None:
    condition, point = solved(published_aircraft, release(BASE, free=("gamma",), hold={"throttle": 0.0}))
    found = margins(condition, point)
    assert found["gamma"] == pytest.approx(np.radians(60.0) - point.states.pitch)
    assert found["pitch"] == pytest.approx(found["gamma"])
    assert re.search(
        r"^gamma +-2\.55286 +deg +59\.75286$", trim_report(published_aircraft, condition, point).text(), re.M
    )


def test_what_has_no_limit_has_no_margin(published_aircraft: Aircraft) -> None:
    """A free pitch rate: the equation of the pitch angle holds it at zero."""
    condition, point = solved(published_aircraft, release(BASE, free=("pitch_rate",)))
    assert "pitch_rate" not in margins(condition, point)


def test_a_limit_that_is_set_counts(published_aircraft: Aircraft) -> None:
    limited = level_flight(float(np.radians(10.0)), limits={"speed": (60.0, 69.0)})
    known = find_operating_point(published_aircraft, limited).inputs.aileron_outer
    condition, point = solved(published_aircraft, release(limited, free=("speed",), hold={"aileron_outer": known}))
    assert margins(condition, point)["speed"] == pytest.approx(1.0)
