"""Gusts along the span: the uniform one as a special case, beside the linear model, statistics of turbulence; and the
linearized aircraft, which is what the nonlinear one is to first order."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from flight_cases import FlownCase, flown

from controller import Dryden, OneMinusCosine, Scenario
from controller.flight.envelope import angles_of_attack
from controller.flight.gusts import SpanwiseGust, side_by_side, spanwise_dryden
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.simulation import SummedLoop
from hfa_model import LINEAR_STATES, STATES
from hfa_support import BadInputError
from trim import linearize

GUST = OneMinusCosine(100.0, 3.0, 68.0, 0.2)
TURBULENCE = Dryden(3.0, 500.0, 68.0, 0.01, 300, 4)


def test_the_same_gust_on_both_is_the_uniform_one(newton: FlownCase) -> None:
    one = flown(newton, Scenario(duration=2.0, gust=GUST))
    two = flown(newton, Scenario(duration=2.0, gust=side_by_side(GUST, GUST)))
    np.testing.assert_allclose(two.flight.states, one.flight.states, rtol=1e-9, atol=1e-11)
    assert one.predicted is not None
    assert two.predicted is not None
    np.testing.assert_allclose(two.predicted.states, one.predicted.states, rtol=1e-9, atol=1e-11)
    np.testing.assert_array_equal(two.flight.updrafts, np.column_stack([one.flight.updrafts] * 2))
    np.testing.assert_array_equal(two.angles_of_attack, one.angles_of_attack)


def test_the_panels_meet_gusts_of_their_own(newton: FlownCase) -> None:
    later = OneMinusCosine(100.0, -1.5, 68.0, 0.5)
    result = flown(newton, Scenario(duration=3.0, gust=side_by_side(GUST, later)))
    center, outer = result.flight.updrafts.T
    times = result.flight.times
    assert (times[center.argmax()], center.max()) == (pytest.approx(0.2 + 50 / 68, abs=1e-3), pytest.approx(3.0))
    assert (times[outer.argmin()], outer.min()) == (pytest.approx(0.5 + 50 / 68, abs=1e-3), pytest.approx(-1.5))
    header = result.report().records.header
    assert {"updraft_center [ft/s]", "updraft_outer [ft/s]"} <= set(header)
    # The outer panels are pushed down, the center up: the dihedral angle falls, which a uniform gust hardly moves.
    bent = result.flight.states[:, STATES.index("dihedral")]
    uniform = flown(newton, Scenario(duration=3.0, gust=GUST)).flight.states[:, STATES.index("dihedral")]
    assert bent.min() < -5 * np.abs(uniform).max()


def test_the_linear_model_follows_small_gusts(newton: FlownCase) -> None:
    """Halved gusts differ four times less from it; with the columns mixed up only twice."""
    model = linearize(newton.aircraft, newton.point, full=True, disturbances=("updraft", "updraft_outer"))
    linearized = LinearizedAircraft.at(newton.aircraft, newton.point)
    np.testing.assert_allclose(
        np.column_stack([linearized.gust, linearized.outer_gust]), model.E, rtol=1e-12, atol=1e-15
    )
    errors = []
    for size in (0.4, 0.2):
        gust = SpanwiseGust((OneMinusCosine(100.0, size, 68.0),), (1.0,), (-0.5,))
        result = flown(newton, Scenario(duration=1.0, gust=gust))
        assert result.differences is not None
        errors.append(result.differences[STATES.index("dihedral")])
        assert result.report().data["largest_difference_from_linear"]["dihedral"] == errors[-1]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_an_outer_panel_beyond_its_angle_leaves_the_envelope(newton: FlownCase) -> None:
    at, level = np.array(newton.point.states)[None], newton.point.states.alpha
    assert newton.envelope.departure(np.zeros(1), at, np.zeros((1, 2))) is None
    for updrafts in ([[0.0, 40.0]], [[40.0, 0.0]]):
        departure = newton.envelope.departure(np.zeros(1), at, np.array(updrafts))
        assert departure is not None
        assert departure.state == "angle_of_attack"
        assert departure.value == pytest.approx(level + math.atan2(40.0, 68.0), abs=0.05)


def test_a_summed_flight_sees_the_larger_angle(newton: FlownCase) -> None:
    scenario = Scenario(duration=1.5, gust=side_by_side(OneMinusCosine(100.0, 0.5, 68.0), GUST))
    result = flown(newton, scenario)
    summed = SummedLoop(
        result.loop, newton.point, newton.envelope, step=0.001, steps_per_tick=10, stops=True, compile_code=False
    )
    summary = summed.fly(result.loop.start(np.zeros(7)), result.loop.constants(newton.law.constants), 1.5)
    level = newton.point.states.alpha
    peak = np.abs(result.angles_of_attack - level).max()
    assert summary.peak_angle_of_attack == pytest.approx(peak, rel=1e-6)
    of_the_center = np.abs(angles_of_attack(result.states, result.flight.updrafts[:, 0]) - level).max()
    assert abs(of_the_center - peak) > 0.3 * peak  # it climbs with the outer panels through calm air


@pytest.mark.parametrize("distance", [20.0, 80.0, 300.0])
def test_turbulence_has_the_covariance_of_three_panels(distance: float) -> None:
    """The model's w_o is the mean of left and right: S C S' of the three panels, C from the correlation at 0, d, 2d."""
    spanwise = spanwise_dryden(TURBULENCE, distance)

    def correlation(r: float) -> float:
        return math.exp(-r / 500.0) * (1 - r / 1000.0)

    places = np.array([0.0, -distance, distance])
    C = np.vectorize(correlation)(np.abs(places[:, None] - places))
    S = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5]])
    shares = np.array([spanwise.center, spanwise.outer])
    np.testing.assert_allclose(shares @ shares.T, S @ C @ S.T, rtol=1e-12)
    first, second = spanwise.sources
    assert isinstance(second, Dryden)
    assert first == TURBULENCE
    assert second.seed != TURBULENCE.seed
    assert spanwise == spanwise_dryden(TURBULENCE, distance)


def test_turbulence_is_flown_from_both_sources(newton: FlownCase) -> None:
    result = flown(newton, Scenario(duration=3.0, gust=spanwise_dryden(TURBULENCE, 80.0)))
    alone = flown(newton, Scenario(duration=3.0, gust=TURBULENCE))
    center, outer = result.flight.updrafts.T
    np.testing.assert_allclose(center, alone.flight.updrafts, rtol=1e-9, atol=1e-12)
    assert 0.1 < np.abs(outer - center).max() < 9.0
    with pytest.raises(BadInputError, match=r"is 0\.0 ft; it must"):
        spanwise_dryden(TURBULENCE, 0.0)


def test_the_linearized_aircraft_is_the_derivative_of_the_nonlinear_one(at_15: FlownCase) -> None:
    full = linearize(at_15.aircraft, at_15.point, full=True)
    model = LinearizedAircraft.at(at_15.aircraft, at_15.point)
    np.testing.assert_allclose(model.A, full.A, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(model.B, full.B, rtol=1e-13, atol=1e-13)
    plant = NonlinearPlant(at_15.aircraft, at_15.point)
    rise = 1e-3
    up, down = (
        np.array(plant.rate(np.zeros(7), np.zeros(5), np.zeros(len(LINEAR_STATES)), w)).ravel() for w in (rise, -rise)
    )
    np.testing.assert_allclose((up - down) / (2 * rise), model.gust, rtol=1e-6, atol=1e-9)


def test_the_air_at_the_outer_panels_enters_by_its_own_column(at_15: FlownCase) -> None:
    """b w + b_o (w_o - w) is the derivative of the nonlinear rate in both winds."""
    model, plant = LinearizedAircraft.at(at_15.aircraft, at_15.point), NonlinearPlant(at_15.aircraft, at_15.point)
    nothing = (np.zeros(7), np.zeros(5), np.zeros(len(LINEAR_STATES)))
    for winds in (np.array([1e-3, 0.0]), np.array([0.0, 1e-3]), np.array([1e-3, -2e-3])):
        up, down = (np.array(ca.DM(plant.rate(*nothing, ca.SX(ca.DM(w))))).ravel() for w in (winds, -winds))
        linear = np.array(ca.DM(model.rate(*nothing, winds))).ravel()
        np.testing.assert_allclose((up - down) / 2, linear, rtol=1e-6, atol=1e-11)
        assert np.abs(linear).max() > 1e-7
