"""An altitude that nobody holds keeps its initial value, in trims and sweeps."""

from __future__ import annotations

from typing import Any

import casadi as ca
import pytest

from hfa import Model, Signal, sweep, trim


def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Return the rates of a small aircraft in air whose density falls with the altitude."""
    pressure = 0.5 * 1.225 * ca.exp(-x.altitude / 9000.0) * x.speed**2 * 17.1
    lift = pressure * (0.41 + 4.44 * x.alpha + 0.355 * u.elevator)
    drag = pressure * (0.05 + 0.33 * x.alpha)
    moment = pressure * 1.74 * (-0.683 * x.alpha - 0.923 * u.elevator)
    damping = pressure * 1.74 * 9.96 * 1.74 / (2 * x.speed) * x.pitch_rate
    gamma = x.pitch - x.alpha
    rates = {
        "speed": (u.thrust * ca.cos(x.alpha) - drag) / 1250.0 - 9.81 * ca.sin(gamma),
        "alpha": x.pitch_rate
        + (9.81 * ca.cos(gamma) - (u.thrust * ca.sin(x.alpha) + lift) / 1250.0) / x.speed,
        "pitch": x.pitch_rate,
        "pitch_rate": (moment - damping) / 4000.0,
        "altitude": x.speed * ca.sin(gamma),
    }
    return rates, {}


ANGLE = Signal("rad", nominal=0.1, min=-0.4, max=0.4)
AIRCRAFT = Model(
    "craft",
    {
        "speed": Signal("m/s", 50.0, 20.0, 100.0, 50.0),
        "alpha": ANGLE,
        "pitch": ANGLE,
        "pitch_rate": Signal("rad/s", nominal=0.1),
        "altitude": Signal("m", nominal=1000.0, start=500.0),
    },
    {"thrust": Signal("N", nominal=1000.0, min=0.0, max=6000.0), "elevator": ANGLE},
    equations,
    trim={"speed": 50.0},
)


@pytest.mark.parametrize("altitude", [500.0, 3000.0])
def test_a_trim_keeps_the_altitude_where_it_begins(altitude: float) -> None:
    """The trim and its modes are those with the altitude held there, and the report says so."""
    free = trim(AIRCRAFT, start={"altitude": altitude})
    held = trim(AIRCRAFT, hold={"altitude": altitude})
    assert dict(free) == pytest.approx(dict(held), rel=1e-9, abs=1e-12)
    said = "Neither held nor determined, kept at the initial value: altitude"
    assert (said in str(free.report()), said in str(held.report())) == (True, False)


def test_a_sweep_keeps_the_altitude() -> None:
    """Each point of a sweep is at the initial altitude."""
    points = [linear.point for linear in sweep(AIRCRAFT, speed=[40.0, 55.0, 70.0])]
    assert [point["altitude"] for point in points] == [500.0] * 3


def test_an_altitude_that_the_equations_determine_is_found() -> None:
    """With the thrust held, level flight determines the altitude, as before."""
    thrust = trim(AIRCRAFT, hold={"altitude": 2000.0})["thrust"]
    found = trim(AIRCRAFT, hold={"thrust": thrust})
    assert found["altitude"] == pytest.approx(2000.0, rel=1e-6)
