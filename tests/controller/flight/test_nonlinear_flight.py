"""Flights of the nonlinear aircraft: what a scenario does, where a flight ends, and the envelope that says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_models import SMALL, FlownCase, flown, signal

from controller import OneMinusCosine, Scenario, flight_envelope, fly, gain_law
from controller.flight.nonlinear_flight import UNDISTURBED
from hfa_model import LINEAR_STATES, STATES
from hfa_support import BadInputError

N = len(LINEAR_STATES)


def test_altitude_is_flown_and_an_updraft_lifts(newton: FlownCase) -> None:
    result = flown(newton, Scenario(duration=8.0, gust=OneMinusCosine(200.0, 4.0, 68.0)))
    gained = result.states[-1, STATES.index("altitude")] - newton.point.states.altitude
    # The air rises 4/2 ft/s on average for 200/68 s; the aircraft, held in pitch, goes with it.
    assert gained == pytest.approx(2.0 * 200.0 / 68.0, rel=0.05)


def test_errors_are_those_of_the_flown_aircraft_alone(newton: FlownCase) -> None:
    """The heavier aircraft is out of trim and sinks; the prediction, of the design, stays."""
    result = flown(newton, Scenario(duration=2.0, errors={"panel_mass": 1.05}))
    assert result.predicted is not None
    assert np.abs(result.predicted.states).max() < 1e-12
    assert result.flight.states[-1, STATES.index("altitude")] < -0.01


def test_the_measured_error_has_noise_and_the_flown_one_has_none(newton: FlownCase) -> None:
    result = flown(newton, Scenario(duration=0.1, noise=signal(speed=0.01)))
    np.testing.assert_array_equal(result.flight.errors[0], np.zeros(N))
    gain = newton.law.gains[0]
    np.testing.assert_allclose(result.flight.inputs[0], -gain[:, 0] * 0.01, rtol=1e-12)


def test_a_flight_ends_where_its_first_state_leaves(newton: FlownCase) -> None:
    result = flown(newton, Scenario(initial=SMALL * np.array([10.0, 1, 1, 1, 1, 1, 1])))
    departure = result.departure
    assert departure is not None
    assert departure.state == "pitch_rate"
    before = result.flight.times < departure.time
    assert not newton.envelope.outside(result.states[before]).any()
    row = int(np.argmin(before))
    assert result.states[row, STATES.index("pitch_rate")] == departure.value
    assert abs(departure.value) > abs(departure.limit)
    assert result.flight.times[-1] < departure.time + 0.02


def test_the_envelope_limits_the_angle_through_the_air_and_not_the_one_over_ground(newton: FlownCase) -> None:
    """In rising air the path climbs: alpha over ground falls to -1.5 deg, alpha through the air stays near 2.8."""
    gust, alpha = Scenario(duration=6.0, gust=OneMinusCosine(400.0, 5.0, 68.0)), STATES.index("alpha")
    for lowest, held in ((2.0, True), (2.7, False)):
        limits = {"alpha": (float(np.radians(lowest)), 0.2)}
        narrow = replace(newton, envelope=flight_envelope(newton.aircraft, newton.point, limits))
        result = flown(narrow, gust)
        degrees = np.degrees(result.angles_of_attack)
        assert (result.departure is None) == held
        if held:
            assert np.degrees(result.states[:, alpha]).min() < -1.4
            assert (degrees.min(), degrees.max()) == (pytest.approx(2.61, abs=0.005), pytest.approx(2.97, abs=0.005))
        else:
            assert result.departure is not None
            row = int(np.argmax(result.flight.times >= result.departure.time))
            assert result.departure[:3] == ("angle_of_attack", result.flight.times[row], result.angles_of_attack[row])
            assert np.degrees(result.angles_of_attack[row - 1]) > lowest
        report = result.report()
        assert "alpha is over ground; the envelope limits angle_of_attack" in report.text()
        assert "alpha" not in report.data["envelope"]
        assert report.data["envelope"]["angle_of_attack"] == list(limits["alpha"])
        assert report.data["largest_deviation"]["angle_of_attack"] < 0.1 * report.data["largest_deviation"]["alpha"]


def test_a_flight_that_nothing_disturbs_says_so(newton: FlownCase) -> None:
    assert repr(flown(newton, Scenario(duration=0.1))).endswith(f"Note: {UNDISTURBED}")
    assert UNDISTURBED not in repr(flown(newton, Scenario(duration=0.1, errors={"lift_slope": 1.1})))


def test_speed_and_altitude_are_limited_about_the_trim(newton: FlownCase) -> None:
    at, low, high = newton.point.states, newton.envelope.lowest, newton.envelope.highest
    assert (low.speed, high.speed) == (at.speed / 2, 2 * at.speed)
    assert (at.altitude - low.altitude, high.altitude - at.altitude) == (1000.0, 1000.0)
    assert high.pitch_rate == -low.pitch_rate > 0.0


def test_the_envelope_can_be_changed_and_must_hold_the_trim(newton: FlownCase) -> None:
    p, point = newton.aircraft, newton.point
    narrow = flight_envelope(p, point, {"dihedral": (0.2, 0.3)})
    assert (narrow.lowest.dihedral, narrow.highest.dihedral) == (0.2, 0.3)
    assert narrow.highest.alpha == newton.envelope.highest.alpha
    with pytest.raises(BadInputError, match="no state 'roll'"):
        flight_envelope(p, point, {"roll": (0.0, 1.0)})
    with pytest.raises(BadInputError, match=r"has dihedral 15 deg, outside the envelope's 0 deg to 5\.72958 deg"):
        flight_envelope(p, point, {"dihedral": (0.0, 0.1)})


def test_gains_of_several_ticks_follow_each_other_and_the_last_stays(newton: FlownCase) -> None:
    gains = np.random.default_rng(1).normal(size=(3, 5, 6))
    law = gain_law("several", gains)
    np.testing.assert_array_equal(law.gains, gains)
    for tick, gain in ((0, 0), (2, 2), (99, 2)):
        np.testing.assert_array_equal(law.constants(tick), gains[gain].ravel(order="F"))
    with pytest.raises(BadInputError, match=r"shape \(6, 5\); this aircraft takes 5 x 6"):
        fly(newton.aircraft, newton.point, gain_law("bad", gains[0].T), Scenario(duration=0.1), newton.envelope)
