"""Flights of the nonlinear aircraft: what a scenario does, and where a flight ends."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from flight_cases import SMALL, FlownCase, case_at, flown, signal

from controller.flight.gusts import OneMinusCosine
from controller.flight.simulate import Scenario
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES, STATES

N = len(LINEAR_STATES)


@pytest.fixture(scope="module", params=["published", "newton"])
def at_15(request: pytest.FixtureRequest, parameters: Parameters) -> FlownCase:
    return case_at(parameters, request.param, 15.0)


@pytest.fixture(scope="module")
def newton(parameters: Parameters) -> FlownCase:
    return case_at(parameters, "newton", 15.0)


def test_at_rest_nothing_moves(at_15: FlownCase) -> None:
    result = flown(at_15, Scenario(duration=0.5))
    assert result.departure is None
    assert np.abs(result.flight.states).max() < 1e-10


def test_a_flight_shows_its_report_at_the_prompt_and_can_be_kept(newton: FlownCase) -> None:
    result = flown(newton, Scenario(duration=0.1, gust=OneMinusCosine(200.0, 4.0, 68.0)))
    assert repr(result).startswith("Flight, newton dynamics, dihedral 15 deg\nheld: 0.1 s inside the envelope\n\nstate")
    kept = pickle.loads(pickle.dumps(result))
    np.testing.assert_array_equal(kept.flight.states, result.flight.states)
    assert kept.report().text() == repr(result)


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
    gain = newton.plan.gains[0]
    np.testing.assert_allclose(result.flight.inputs[0], -gain[:, 0] * 0.01, rtol=1e-12)


def test_a_flight_ends_where_its_first_state_leaves(newton: FlownCase) -> None:
    result = flown(newton, Scenario(initial=SMALL * np.array([10.0, 1, 1, 1, 1, 1, 1])))
    departure = result.departure
    assert departure is not None
    assert departure.state == "pitch_rate"
    before = result.flight.times < departure.time
    assert newton.envelope.inside(result.states[before]).all()
    row = int(np.argmin(before))
    assert result.states[row, STATES.index("pitch_rate")] == departure.value
    assert abs(departure.value) > abs(departure.limit)
    assert result.flight.times[-1] < departure.time + 0.02


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"step": 0.0}, "step is 0.0"),
        ({"step": 0.003}, "whole number of steps"),
        ({"duration": 1.005}, "whole number of ticks"),
        ({"duration": np.inf}, "duration is inf"),
        ({"errors": {"span": 0.9}}, "unknown parameter 'span'"),
        ({"errors": {"lift_slope": 0.0}}, "factor of 0.0"),
    ],
)
def test_scenarios_that_cannot_be_flown_are_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(BadInputError, match=said):
        Scenario(**change)
