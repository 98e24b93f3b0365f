"""Scheduled gains in flight.

Near each trim, the policy is the gain of this trim. The aircraft follows slow commands along the
trims.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_models import exact_gain, model_at
from simulated_cases import measurements_of

from hfa import BadInputError, fly
from hfa_flight import CommandSteps, GainSchedule, Scenario, flight_envelope
from hfa_flight.flight import Flight
from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy, scheduled_gains
from hfa_model import LINEAR_STATES, STATES
from trim.hfa.level_flight import level_flight

N = len(LINEAR_STATES)
DIHEDRAL = LINEAR_STATES.index("dihedral")


def exact_gains(*degrees: float) -> GainSchedule:
    """Return the schedule of the exact gains at these dihedral angles, deg."""
    gains = np.array([exact_gain(angle) for angle in degrees])
    return GainSchedule(np.radians(degrees), gains, model_at(degrees[0]).point.model)


def policy_from(schedule: GainSchedule, start: float, end: float) -> ScheduledGainPolicy:
    """Return the policy of a schedule for a flight from one dihedral angle to another.

    start: angle of the trim at which the flight begins, deg
    end: commanded angle from 1 s on, deg
    """
    steps = CommandSteps(("dihedral",), np.array([1.0]), np.radians([[end - start]]))
    return scheduled_gains("gains", schedule, model_at(start).point, steps, level_flight)


# The policy near a trim.


def slope_at(policy: ScheduledGainPolicy, degrees: float) -> tuple[np.ndarray, np.ndarray]:
    """Return u, (5,), and ∂u/∂z, (5, 6), at z = 0 for a constant command of this angle."""
    commands = CommandSteps(
        ("dihedral",), np.zeros(1), np.radians([[degrees]]) - policy.path.base.states.dihedral
    )
    resting = replace(policy, path=replace(policy.path, commands=commands))
    z = ca.SX.sym("z", N)
    late = ca.SX(1e4)
    measurements = measurements_of(z)._replace(states=z + resting.path.at(late))
    u = resting.control(late, measurements, ca.SX(0, 1), ca.SX(0, 1))
    values = ca.Function("policy", [z], [u, ca.jacobian(u, z)])(ca.DM.zeros(N))
    return np.array(values[0]).ravel(), np.array(ca.DM(values[1]))


@pytest.mark.parametrize("degrees", [5.0, 10.0, 15.0])
def test_at_breakpoints_the_policy_equals_gain_and_trim(degrees: float) -> None:
    """At a breakpoint, the policy equals the trim input, and its derivative is -K for the K
    there.
    """
    policy = policy_from(exact_gains(5.0, 10.0, 15.0), 5.0, 15.0)
    u, slope = slope_at(policy, degrees)
    trims = (np.array(model_at(angle).point.inputs) for angle in (degrees, 5.0))
    np.testing.assert_allclose(u, next(trims) - next(trims), atol=1e-12)
    np.testing.assert_allclose(slope, -exact_gain(degrees), rtol=1e-9, atol=1e-12)


def test_the_reference_moves_along_the_trims() -> None:
    """While the command changes, the rate of the reference is the slope of its dihedral angle."""
    path = policy_from(exact_gains(5.0, 15.0), 5.0, 15.0).path
    t = ca.SX.sym("t")
    at = ca.Function("at", [t], [path.at(t)])
    before, now, after = (np.array(at(time)).ravel() for time in (3.0 - 1e-4, 3.0, 3.0 + 1e-4))
    rate = now[LINEAR_STATES.index("dihedral_rate")]
    assert rate == pytest.approx((after - before)[DIHEDRAL] / 2e-4, rel=1e-6)
    assert rate > 1e-3


# The flight.


def scheduled_flight(schedule: GainSchedule, start: float, end: float) -> Flight:
    policy = policy_from(schedule, start, end)
    base = policy.path.base
    scenario = Scenario(duration=60.0, step=0.002, reference=policy.path)
    envelope = flight_envelope(schedule.model, base)
    return fly(schedule.model, base, policy, scenario=scenario, envelope=envelope, predict=False)


@pytest.mark.parametrize(
    ("start", "end"), [(5.0, 15.0), pytest.param(15.0, 5.0, marks=pytest.mark.slow)]
)
def test_a_schedule_follows_a_dihedral_change(start: float, end: float) -> None:
    """Scheduled gains change the dihedral to another trim.

    The errors remain small and the inputs reach that trim.
    """
    result = scheduled_flight(exact_gains(5.0, 10.0, 15.0), start, end)
    assert result.departure is None
    assert np.degrees(result.states[-1, STATES.index("dihedral")]) == pytest.approx(end, abs=0.02)
    largest = np.abs(result.flight.errors).max(axis=0)
    assert largest[LINEAR_STATES.index("speed")] < 0.05
    assert np.degrees(largest[LINEAR_STATES.index("alpha")]) < 0.5
    assert np.degrees(largest[DIHEDRAL]) < 2.5
    np.testing.assert_allclose(result.inputs[-1], model_at(end).point.inputs, atol=2e-3)
    data = result.report().data["policy"]
    np.testing.assert_allclose(data["dihedral_deg"], [5.0, 10.0, 15.0])


@pytest.mark.slow  # a smaller change is simulated above
def test_scheduled_gains_stay_inside_the_envelope() -> None:
    """From 0 to 20 degrees, the flight with scheduled gains stays inside the envelope.

    With the gain of 0 degrees at all angles, the flight leaves the envelope.
    """
    wide = exact_gains(0.0, 5.0, 10.0, 15.0, 20.0)
    assert scheduled_flight(wide, 0.0, 20.0).departure is None
    kept = replace(wide, gains=np.array([wide.gains[0]] * 5))
    assert scheduled_flight(kept, 0.0, 20.0).departure is not None


@pytest.mark.parametrize(
    ("changes", "command", "said"),
    [
        ({}, "speed", "follows only commands of dihedral; remove the command of speed"),
        ({"gains": np.zeros((2, 5, 11))}, "dihedral", "K has 11 columns"),
        ({"breakpoints": np.radians([5.0, 8.0])}, "dihedral", "cover 5 deg to 8 deg, but 5 deg to"),
    ],
)
def test_unusable_schedules_are_refused(changes: dict[str, Any], command: str, said: str) -> None:
    """Commands of other outputs, gains of wrong shape and missing dihedrals are refused."""
    schedule = replace(exact_gains(5.0, 15.0), **changes)
    steps = CommandSteps((command,), np.zeros(1), np.array([[0.1]]))
    with pytest.raises(BadInputError, match=said):
        scheduled_gains("gains", schedule, model_at(5.0).point, steps, level_flight)
