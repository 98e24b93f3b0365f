"""The numbers of a trim, each by a second route."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from ambiance import Atmosphere

from hfa_model import Aircraft
from trim import OperatingPoint, find_operating_point, level_flight
from trim.point.hfa_report import performance

METRE_PER_FOOT = 0.3048


@pytest.fixture(params=[0.0, 3.0], ids=["level", "climb"])
def flown(request: pytest.FixtureRequest, aircraft: Aircraft) -> tuple[OperatingPoint, SimpleNamespace]:
    condition = level_flight(math.radians(11.0), speed=70.0, altitude=20_000.0, gamma=math.radians(request.param))
    point = find_operating_point(aircraft, condition)
    return point, SimpleNamespace(**performance(aircraft, point))


def test_coefficients_times_pressure_times_area_are_the_forces(
    aircraft: Aircraft, flown: tuple[OperatingPoint, SimpleNamespace]
) -> None:
    point, found = flown
    loads, p = aircraft.loads(point.states, point.inputs), aircraft.parameters
    kilogram_per_m3 = float(Atmosphere(point.states.altitude * METRE_PER_FOOT).density[0])
    pressure = 0.5 * kilogram_per_m3 * (point.states.speed * METRE_PER_FOOT) ** 2  # Pa
    assert found.dynamic_pressure == pytest.approx(pressure / 47.880259, rel=2e-6)
    assert found.dynamic_pressure == pytest.approx(found.density * point.states.speed**2 / 2, rel=1e-14)
    assert found.wing_area == pytest.approx(1920.0, rel=1e-5)  # three panels of 80 ft by 8 ft
    assert found.lift_coefficient * found.dynamic_pressure * found.wing_area == pytest.approx(loads.lift, rel=1e-13)
    assert found.drag_coefficient * found.dynamic_pressure * found.wing_area == pytest.approx(loads.drag, rel=1e-13)
    assert found.lift_over_drag == pytest.approx(loads.lift / loads.drag, rel=1e-13)
    assert found.weight == pytest.approx(3 * p.panel_mass * 32.174, rel=1e-3)


def test_steady_flight_balances_weight_along_and_across_the_path(
    aircraft: Aircraft, flown: tuple[OperatingPoint, SimpleNamespace]
) -> None:
    """L + T sin α = W cos γ,  T cos α - D = W sin γ: the load factor is cos γ."""
    point, found = flown
    loads, alpha, gamma = aircraft.loads(point.states, point.inputs), point.states.alpha, point.values["gamma"]
    assert loads.lift + loads.thrust * math.sin(alpha) == pytest.approx(found.weight * math.cos(gamma), rel=1e-9)
    assert loads.thrust * math.cos(alpha) - loads.drag == pytest.approx(found.weight * math.sin(gamma), abs=1e-6)
    assert found.load_factor == pytest.approx(math.cos(gamma), rel=1e-9)
    assert found.hinge_moment_total == pytest.approx(0.0, abs=1e-6)
    assert found.hinge_moment_total == pytest.approx(
        loads.hinge_moment - aircraft.parameters.hinge_stiffness * point.states.dihedral, abs=1e-9
    )


@pytest.mark.parametrize(
    ("altitude", "metres_per_second"),
    # U.S. Standard Atmosphere, 1976, Table III: speed of sound at geometric altitudes; 12,192 m = 40,000 ft.
    [(0.0, 340.29), (5_000 / METRE_PER_FOOT, 320.55), (40_000.0, 295.07)],
)
def test_mach_is_speed_over_the_printed_speed_of_sound(
    published_aircraft: Aircraft, point: OperatingPoint, altitude: float, metres_per_second: float
) -> None:
    there = replace(point, states=point.states._replace(altitude=altitude))
    found = SimpleNamespace(**performance(published_aircraft, there))
    assert found.mach == pytest.approx(68.0 * METRE_PER_FOOT / metres_per_second, rel=2e-5)
    assert found.speed_of_sound * METRE_PER_FOOT == pytest.approx(metres_per_second, abs=5e-3)
