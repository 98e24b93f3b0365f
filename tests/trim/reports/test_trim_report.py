"""The report of a trim: variables, limits, verdicts, loads and performance."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from ambiance import Atmosphere
from sheet_values import values

import hfa_model
from hfa import trim
from hfa.paper import level_flight
from trim import release, trim_report

BASE = level_flight(float(np.radians(10.0)))


def reported(aircraft, condition):
    point = trim(aircraft, condition)
    return point, trim_report(point)


LEVEL = level_flight(math.radians(11.0), speed=70.0, altitude=20_000.0)
GLIDE = release(LEVEL, free=("gamma",), hold={"throttle": 0.0})


@pytest.mark.parametrize("condition", [LEVEL, GLIDE], ids=["level", "glide"])
def test_performance_follows_from_the_loads(published_aircraft, condition):
    """The figures of a level flight at 70 ft/s and 20,000 ft, and of a glide with the throttle at 0, follow
    from the loads of the model and from the standard air.

    Forces balance along and across the path: T cos α - D = W sin γ, L + T sin α = W cos γ. The hinge
    moment of the loads balances that of the elastic hinge.
    """
    point = trim(published_aircraft, condition)
    gamma = point.values["gamma"]
    figures = SimpleNamespace(
        **{name.replace(" ", "_"): value for name, value in values(point.report().data).items()}
    )
    p = hfa_model.parameters_of(published_aircraft)
    alpha = point.states.alpha
    loads = hfa_model.loads(published_aircraft, point.states, point.inputs)

    # Air and reference area.
    air = Atmosphere(point.states.altitude * 0.3048)
    metres_per_second = point.states.speed * 0.3048
    pressure = 0.5 * float(air.density[0]) * metres_per_second**2  # Pa
    assert figures.mach == pytest.approx(metres_per_second / float(air.speed_of_sound[0]), rel=1e-6)
    assert figures.dynamic_pressure == pytest.approx(pressure / 47.880259, rel=2e-6)
    assert pytest.approx(1920.0, rel=1e-5) == figures.S  # three panels of 80 ft by 8 ft

    # Forces and hinge moment.
    assert loads.thrust * math.cos(alpha) - loads.drag == pytest.approx(
        figures.weight * math.sin(gamma), abs=1e-6
    )
    across = figures.lift + loads.thrust * math.sin(alpha)
    assert across == pytest.approx(figures.weight * math.cos(gamma), rel=1e-9)
    force = figures.dynamic_pressure * figures.S / 3.0  # of one panel
    assert figures.lift_coefficient_outer * force == pytest.approx(loads.outer.lift, rel=5e-4)
    assert figures.hinge_moment_total == pytest.approx(0.0, abs=1e-6)
    elastic = p.hinge_stiffness * point.states.dihedral
    assert figures.hinge_moment_total == pytest.approx(loads.hinge_moment - elastic, abs=1e-9)


def test_imposed_rates_are_balanced_and_freed(published_aircraft):
    """With the imposed rate V' = 0.5 ft/s², the thrust along the path exceeds that of level flight by m V'.

    The report and the words of the condition state the rate. Set free again, it is stated as free.
    """
    level = trim(published_aircraft, BASE)
    point, report = reported(published_aircraft, release(BASE, hold={"speed_dot": 0.5}))
    rates = published_aircraft.rates_at(point.states, point.inputs)
    assert rates["speed"] == pytest.approx(0.5, abs=1e-9)
    mass = report.data["sheet"]["weight"]["value"] / 32.174
    thrust = [each["thrust"] * math.cos(each["alpha"]) for each in (level, point)]
    assert thrust[1] - thrust[0] == pytest.approx(0.5 * mass, rel=0.02)
    assert report.data["equations"]["speed"]["imposed"] == 0.5
    assert "accelerated" in report.title
    condition = point.found_by.asked
    assert condition.in_words() == "dihedral 10 deg, speed_dot 0.5 ft/s^2"
    assert condition.changes["rates"]["speed"] == 0.5
    again = release(condition, free=("speed_dot", "throttle"), hold={"alpha": 0.05})
    assert "speed" not in again.rates
    assert "speed_dot free" in again.in_words()
