"""Nonlinear flights: effects of a scenario, ends of a flight, and comparisons.

Nonlinear flights agree with the linear prediction to second order.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_points import STATE_SCALES
from simulated_cases import SimulatedCase, simulate_case

from hfa import BadInputError, trim
from hfa.paper import level_flight
from hfa_flight import (
    GainPolicy,
    OneMinusCosine,
    Policy,
    Scenario,
    flight_envelope,
)
from hfa_flight.closed_loop import ClosedLoop, LinearPlant, NonlinearPlant
from hfa_flight.simulation import CompiledLoop
from hfa_model import LINEAR_STATES, STATES, State

N = len(LINEAR_STATES)


def test_parameter_errors_do_not_change_the_linear_prediction(newton: SimulatedCase) -> None:
    """A parameter error changes the nonlinear flight but not the linear prediction.

    An aircraft that is 5 % heavier descends. The linear prediction stays at trim.
    """
    result = simulate_case(newton, Scenario(duration=2.0, errors={"panel_mass": 1.05}))
    assert result.predicted is not None
    assert np.abs(result.predicted.states).max() < 1e-12
    assert result.flight.states[-1, STATES.index("altitude")] < -0.01


def test_the_envelope_limits_alpha_relative_to_the_air(
    newton: SimulatedCase,
) -> None:
    """In a gust, the envelope limits the angle of attack relative to the air, not alpha.

    alpha, which is over ground, falls below -1.4 deg, but the angle relative to the air stays between 2.6 and 3 deg.
    """
    gust = Scenario(duration=6.0, gust=OneMinusCosine(400.0, 5.0, 68.0))
    alpha = STATES.index("alpha")
    for lowest, held in ((2.0, True), (2.7, False)):
        limits = {"alpha": (float(np.radians(lowest)), 0.2)}
        narrow = replace(newton, envelope=flight_envelope(newton.aircraft, newton.point, limits))
        result = simulate_case(narrow, gust)
        degrees = np.degrees(result.angles_of_attack)
        assert (result.departure is None) == held
        if held:
            assert np.degrees(result.states[:, alpha]).min() < -1.4
            assert (degrees.min(), degrees.max()) == (
                pytest.approx(2.61, abs=0.005),
                pytest.approx(2.97, abs=0.005),
            )
        else:
            assert result.departure is not None
            row = int(np.argmax(result.flight.times >= result.departure.time))
            assert result.departure[:3] == (
                "angle_of_attack",
                result.flight.times[row],
                result.angles_of_attack[row],
            )
            assert np.degrees(result.angles_of_attack[row - 1]) > lowest
        report = result.report()
        assert (
            "alpha is relative to the ground; the envelope limits angle_of_attack" in report.text()
        )
        assert "alpha" not in report.data["envelope"]
        assert list(report.data["envelope"]["angle_of_attack"]) == list(limits["alpha"])
        assert (
            report.data["largest_deviation"]["angle_of_attack"]
            < 0.1 * report.data["largest_deviation"]["alpha"]
        )


def test_the_default_envelope_is_centered_at_the_trim(newton: SimulatedCase) -> None:
    """The default envelope is centered at the trim. Limits can be changed. Wrong limits are
    refused.
    """
    p = newton.aircraft
    point = newton.point
    at = point.states
    low = State(*newton.envelope.lowest)
    high = State(*newton.envelope.highest)
    assert (low.speed, high.speed) == (at.speed / 2, 2 * at.speed)
    assert (at.altitude - low.altitude, high.altitude - at.altitude) == (1000.0, 1000.0)
    assert high.pitch_rate == -low.pitch_rate > 0.0
    narrow = flight_envelope(p, point, {"dihedral": (0.2, 0.3)})
    dihedral = STATES.index("dihedral")
    assert (narrow.lowest[dihedral], narrow.highest[dihedral]) == (0.2, 0.3)
    assert State(*narrow.highest).alpha == high.alpha
    with pytest.raises(BadInputError, match="no state 'roll'"):
        flight_envelope(p, point, {"roll": (0.0, 1.0)})
    with pytest.raises(
        BadInputError,
        match="initial speed is -2 ft/s, beyond the limit of 34 ft/s; choose an initial condition",
    ):
        simulate_case(newton, Scenario(duration=0.1, initial=-70.0 * np.eye(7)[0]))
    with pytest.raises(
        BadInputError,
        match=r"dihedral is 15 deg at trim, outside the envelope, 0 deg to 5\.72958 deg",
    ):
        flight_envelope(p, point, {"dihedral": (0.0, 0.1)})
    with pytest.raises(
        BadInputError, match=r"dihedral is \(0.3, 0.2\); give two different numbers"
    ):
        flight_envelope(p, point, {"dihedral": (0.3, 0.2)})


def test_gains_of_several_ticks_are_applied_in_turn(newton: SimulatedCase) -> None:
    """Gains given for several ticks are applied in turn. The last gain is applied from then on."""
    gains = np.random.default_rng(1).normal(size=(3, 5, 6))
    law = GainPolicy("several", gains)
    np.testing.assert_array_equal(law.gains, gains)
    for tick, gain in ((0, 0), (2, 2), (99, 2)):
        np.testing.assert_array_equal(law.held_inputs(tick), gains[gain].ravel(order="F"))


#: Factors on 1 ft/s, 1 deg and 1 deg/s; large enough that rounding has no effect.
SIZES = (0.001, 0.004, 0.016)
DIRECTION = np.array([1.0, 0.017, 10.0, 0.017, 0.017, 0.017, 0.017])


def slopes(plant: NonlinearPlant, linear: LinearPlant, law: Policy) -> np.ndarray:
    """Return for each state the order of the linear model's error in the size of the deviation,
    (7,).

    The order is d log |x_nonlinear - x_linear| / d log size for initial deviations SIZES x
    DIRECTION. It is 2 if the linear model is the derivative of the nonlinear one, and 1 otherwise.
    """
    scenario = Scenario(1.0, 0.002, 0.05, DIRECTION)
    loops = [CompiledLoop(ClosedLoop(each, law, scenario)) for each in (plant, linear)]
    errors = []
    for size in SIZES:
        one, other = (
            loop.fly(replace(scenario, initial=size * DIRECTION)).states for loop in loops
        )
        errors.append(np.abs(one - other).max(axis=0) / np.array(STATE_SCALES))
    return np.asarray(np.polyfit(np.log(SIZES), np.log(errors), 1)[0])


def test_the_linear_predictions_error_is_of_second_order(
    newton: SimulatedCase, at_15: SimulatedCase
) -> None:
    """The linear model's error is of second order in the deviation.

    A linear model at a dihedral angle that is wrong by half a degree has an error of first order.
    """
    for case, off in ((at_15, 0.0), (newton, 0.5)):
        other = trim(case.aircraft, level_flight(float(np.radians(15.0 + off))))
        linear = LinearPlant.at(case.aircraft, other)
        found = dict(
            zip(
                STATES,
                slopes(NonlinearPlant(case.aircraft, case.point), linear, case.law),
                strict=True,
            )
        )
        if off:
            assert max(found[name] for name in ("alpha", "pitch", "pitch_rate", "dihedral")) < 1.5
        else:
            assert all(1.9 < slope < 2.1 for slope in found.values()), found
