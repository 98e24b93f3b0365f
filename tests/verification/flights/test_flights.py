"""The gain schedule and the slow change that it flies."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_models import seen

from controller import Scenario, flight_envelope, published_game
from controller.flight.nonlinear_flight import NonlinearFlight
from controller.flight.policies import Measurements
from hfa_aircraft.model import Model
from hfa_model import LINEAR_STATES, STATES
from hfa_support import NoSolutionError
from verification.flights.scheduling import (
    Schedule,
    ScheduledChange,
    ScheduledPolicy,
    certified_schedule,
    change_over,
    fly_schedule,
)

N = len(LINEAR_STATES)


def radians(*degrees: float) -> np.ndarray:
    return np.radians(np.array(degrees))


@pytest.fixture(scope="module")
def certified(published_aircraft: Model) -> Schedule:
    """Exact gains at 5, 10 and 15 degrees."""
    return certified_schedule(published_aircraft, radians(5.0, 10.0, 15.0))


# The gain schedule: its policy about a trim.


def slope_at_trim(certified: Schedule, index: int, policy_of: type[ScheduledPolicy]) -> Any:
    """∂u/∂z of the policy where the command rests at a grid point, (5, 6), and u itself."""
    grid = certified.grid
    dihedral = grid[index].point.states.dihedral
    resting = ScheduledChange(dihedral, dihedral, 0.0, 1.0)
    z = ca.SX.sym("z", N)
    u = policy_of("scheduled", certified, resting, grid[0].point).control(
        5.0, seen(z), ca.SX(0, 1), ca.SX(0, 1)
    )
    found = ca.Function("policy", [z], [u, ca.jacobian(u, z)])(ca.DM.zeros(N))
    return np.array(found[0]).ravel(), np.array(ca.DM(found[1]))


def test_about_a_grid_point_the_policy_is_its_gain_and_its_trim(certified: Schedule) -> None:
    """No hidden coupling: the derivative with respect to the measured dihedral is the gain's own
    column."""
    for index in range(3):
        u, slope = slope_at_trim(certified, index, ScheduledPolicy)
        inputs = certified.tables[1].values
        np.testing.assert_allclose(u, inputs[index] - inputs[0], atol=1e-15)
        np.testing.assert_allclose(slope, -certified.grid[index].gain, rtol=1e-12, atol=1e-15)


class _TrimOfTheMeasuredDihedral(ScheduledPolicy):
    """The mistake that hidden coupling is made of."""

    def control(self, t: Any, told: Measurements, memory: Any, p: Any) -> Any:
        channel = LINEAR_STATES.index("dihedral")
        measured = self.base.states.dihedral + self.at(t)[channel] + told.error[channel]
        inputs = self.schedule.tables[1]
        wrong = inputs.expression(measured) - inputs.expression(self.change.at(t)[0])
        return super().control(t, told, memory, p) + wrong


def test_hidden_coupling_is_seen(certified: Schedule) -> None:
    # At a point inside the grid the slope of a table is one-sided; both sides differ from 0.
    _, slope = slope_at_trim(certified, 1, _TrimOfTheMeasuredDihedral)
    off = slope + certified.grid[1].gain
    assert np.abs(off[:, LINEAR_STATES.index("dihedral")]).max() > 0.01
    assert np.abs(np.delete(off, LINEAR_STATES.index("dihedral"), axis=1)).max() < 1e-12


# Certificates.


def test_every_grid_point_is_certified_and_the_points_between_are_stable(
    certified: Schedule,
) -> None:
    assert [row.certificates for row in certified.grid] == [8, 8, 8]
    assert all(row.control_abscissa < -0.3 and row.game_abscissa < -0.2 for row in certified.grid)
    assert certified.between < -0.3


def test_a_point_without_certificate_stops_the_schedule(published_aircraft: Model) -> None:
    with pytest.raises(NoSolutionError, match="delta_min"):
        certified_schedule(
            published_aircraft,
            radians(5.0, 15.0),
            game=lambda model: published_game(model.A, model.B, delta=100.0),
        )


# The flight.


def through_the_change(
    aircraft: Model, certified: Schedule, start: float, end: float
) -> NonlinearFlight:
    change = change_over(aircraft, float(np.radians(start)), float(np.radians(end)), 60.0)
    envelope = flight_envelope(aircraft, certified.at(change.start).point)
    return fly_schedule(aircraft, certified, change, Scenario(duration=80.0, step=0.002), envelope)


@pytest.mark.parametrize(
    ("start", "end"), [(5.0, 15.0), pytest.param(15.0, 5.0, marks=pytest.mark.slow)]
)
def test_the_schedule_flies_the_change(
    published_aircraft: Model, certified: Schedule, start: float, end: float
) -> None:
    result = through_the_change(published_aircraft, certified, start, end)
    assert result.departure is None
    assert np.degrees(result.states[-1, STATES.index("dihedral")]) == pytest.approx(end, abs=0.01)
    largest = np.abs(result.flight.errors).max(axis=0)
    assert largest[LINEAR_STATES.index("speed")] < 0.01
    assert np.degrees(largest[LINEAR_STATES.index("alpha")]) < 0.2
    assert np.degrees(largest[LINEAR_STATES.index("dihedral")]) < 1.0
    target = certified.at(float(np.radians(end))).point
    np.testing.assert_allclose(result.inputs[-1], target.inputs, atol=1e-3)


@pytest.mark.slow  # the schedule flies a smaller change above
def test_scheduling_the_gain_is_needed_from_0_to_20_degrees(published_aircraft: Model) -> None:
    """The gain of 0 degrees, kept, loses the aircraft on the way; the schedule does not."""
    wide = certified_schedule(published_aircraft, radians(0.0, 5.0, 10.0, 15.0, 20.0))
    assert through_the_change(published_aircraft, wide, 0.0, 20.0).departure is None
    kept = replace(wide, grid=tuple(replace(row, gain=wide.grid[0].gain) for row in wide.grid))
    departure = through_the_change(published_aircraft, kept, 0.0, 20.0).departure
    assert departure is not None
    assert departure.state == "pitch_rate"
