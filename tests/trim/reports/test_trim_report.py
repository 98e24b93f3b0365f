"""The report of a trim: variables, limits, verdicts, loads and performance."""

import math

import numpy as np
import pytest

from hfa import trim
from hfa.paper import level_flight
from trim import release, trim_report

BASE = level_flight(float(np.radians(10.0)))


def reported(aircraft, condition):
    point = trim(aircraft, condition)
    return point, trim_report(point)


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
