"""Simulation of deployment files with `hfa fly --policy`."""

import casadi as ca
import numpy as np
import pytest
from policy_cases import ROOT, SENSORS, stored_deployment, trims

import hfa
from hfa import BadInputError, Deployment, fly, load_model
from hfa_flight import Scenario


@pytest.mark.parametrize(("dt", "delay", "parts"), [(0.02, 0.03, 2), (1.0 / 60.0, 0.02, 5)])
def test_commands_change_at_whole_samples_after_the_delay(dt, delay, parts):
    """Commands change at whole samples after the delay, the first one at the delay, and the flight is
    a whole number of ticks.

    parts: sample time / greatest common divisor of sample time and delay
    """
    flight = flown_with(dt, delay)
    tick = flight.scenario["tick"]
    assert tick == pytest.approx(dt / parts, rel=1e-12)
    assert flight.time[-1] == pytest.approx(round(0.3 / tick) * tick)
    changes = np.flatnonzero(np.abs(np.diff(flight.inputs[:, 0])) > 1e-12)
    after = flight.time[changes + 1] - delay  # np.diff has the row before each change
    assert len(changes) > 3
    assert after[0] == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(after, dt * np.round(after / dt), atol=1e-9)


def test_a_delay_that_is_no_fraction_of_the_sample_time_is_refused():
    """The refusal names the nearest possible delay."""
    with pytest.raises(BadInputError, match=r"timing\.delay is 0.013123456 s.*give 0\.0131"):
        flown_with(0.02, 0.013123456)


def flown_with(dt, delay):
    """Return a flight of the GTM with this sample time and delay."""
    timed = stored_deployment("ppo_gtm").changed(timing={"dt": dt, "delay": delay})
    point = trims("ppo_gtm")[0]
    scenario = Scenario(duration=0.3, initial=np.array([1.0, 0.02, 0.0, 0.0]))
    return fly(point.model, point, timed, scenario=scenario, predict=False)


def test_a_command_that_arrives_at_a_sample_is_not_yet_observed():
    """U_k = 0.3 U_(k-2) + 0.1 of a policy that observes its torque, with a delay of one sample.

    The command of sample k acts from sample k + 1 on, at which the torque before it is observed.
    """
    model = load_model("examples/pendulum.py:PENDULUM")
    o = ca.SX.sym("o", 1)
    deployment = Deployment(
        policy={"file": ca.Function("own", [o], [0.3 * o + 0.1])},
        observation={"torque": {}},
        action={"torque": {"box": [-1.0, 1.0]}},
        timing={"dt": 0.02, "delay": 0.02},
    )
    flight = fly(model, hfa.trim(model), deployment, 0.1, predict=False)
    np.testing.assert_allclose(flight.time[:5], 0.02 * np.arange(5))
    np.testing.assert_allclose(flight.inputs[:5, 0], [0.0, 0.1, 0.1, 0.13, 0.13], rtol=1e-9)


@pytest.fixture
def gtm_point():
    return trims("ppo_gtm")[1]  # the GTM at 45 m/s


def gtm_deployment(**tables):
    """Return the deployment of the GTM example, with samples of 20 ms and no delay.

    tables: changed tables
    """
    return Deployment.load(ROOT / "examples/gtm_policy/on_time.toml").changed(**tables)


def test_the_delay_of_a_filtered_deployment_is_added_once(gtm_point):
    """`in_scenario` adds the delay of the deployment, 0.03 s, to the scenario of a flight. Called again
    with the policy and the scenario of this flight, it adds no delay.
    """
    kalman = hfa.filter(gtm_point.linearize(), SENSORS, "light:1000", 0.02)
    deployed = kalman.policy(gtm_deployment(timing={"dt": 0.02, "delay": 0.03}))
    late = fly(gtm_point.model, gtm_point, deployed, 0.1, predict=False)
    assert (late.policy["filter"]["dt"], late.scenario["delay"]) == (0.02, 0.03)
    _, again = late.loop.policy.in_scenario(late.loop.scenario)
    assert again.delay == 0.03
