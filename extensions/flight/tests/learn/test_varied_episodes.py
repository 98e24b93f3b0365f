"""Episodes of aircraft whose parameters are drawn at each reset."""

from dataclasses import replace

import numpy as np
import pytest
from policy_cases import ROOT, model_of

from hfa import Deployment, environment, trim

pytest.importorskip("gymnasium")
AIRCRAFT = f"{ROOT}/examples/gtm.py:UNCERTAIN_GTM"
LIFT_SLOPE = 1.1
DEPLOYMENT = Deployment(
    policy={},
    observation={"pitch": {}, "load_factor": {}, "speed": {"scale": 10.0}},
    action={"elevator": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    timing={"dt": 0.02, "delay": 0.03},
    cost={"Q": {"pitch": 3.0, "load_factor": 2.0}, "R": {"elevator": 1.0}},
)


def flown(env, start):
    """Return the states, observations and rewards of 50 samples with the same random actions."""
    random = np.random.default_rng(5)
    observation, info = env.reset(seed=1, options={"state": start})
    states, observations, rewards = [info["X"]], [observation], []
    for _ in range(50):
        observation, reward, _, _, info = env.step(random.uniform(-1.0, 1.0, 1))
        states.append(info["X"])
        observations.append(observation)
        rewards.append(reward)
    return np.array(states), np.array(observations), np.array(rewards)


def test_a_varied_episode_is_that_of_the_changed_aircraft_at_the_original_trim():
    """A drawn lift slope changes the aircraft, and not the trim values that observations and costs are
    deviations from. States and observations are therefore those of the changed aircraft if the
    original trim values are numbers in its deployment (`frozen`).

    Without these numbers, load factors and rewards of the changed aircraft differ, and its states do not.
    """
    model = model_of(AIRCRAFT)
    point = trim(model, at=45.0)
    start = np.array(point.states) + 0.01
    states, observations, rewards = flown(
        environment(model, DEPLOYMENT, [point], vary={"lift_slope": (LIFT_SLOPE, LIFT_SLOPE)}),
        start,
    )
    changed = model.with_parameters(lift_slope=LIFT_SLOPE)
    moved = replace(point, model=changed, found_by=None)
    load_factor = model.outputs_at(point.states, point.inputs, ("load_factor",))["load_factor"]
    frozen = DEPLOYMENT.changed(
        observation={
            "pitch": {"about": point["pitch"]},
            "load_factor": {"about": load_factor},
            "speed": {"about": point["speed"], "scale": 10.0},
        }
    )
    expected, seen, _ = flown(environment(changed, frozen, [moved]), start)
    np.testing.assert_allclose(states, expected, rtol=1e-12)
    np.testing.assert_allclose(observations, seen, rtol=1e-6)
    unfrozen, shifted, others = flown(environment(changed, DEPLOYMENT, [moved]), start)
    np.testing.assert_allclose(unfrozen, states, rtol=1e-12)
    load_factors = [*DEPLOYMENT.observation].index("load_factor")
    assert np.abs(observations - shifted)[:, load_factors].min() > 0.01
    assert np.abs(rewards - others).min() > 0.0


def test_each_reset_draws_between_the_limits():
    """Each reset draws another value between the limits, reproducibly by the seed."""
    model = model_of(AIRCRAFT)
    env = environment(model, points=[45.0], vary={"lift_slope": (0.9, 1.1)})
    drawn = [env.reset(seed=3)[1]["parameters"]["lift_slope"]]
    drawn += [env.reset()[1]["parameters"]["lift_slope"] for _ in range(59)]
    assert 0.9 <= min(drawn) < 0.92
    assert 1.08 < max(drawn) <= 1.1
    assert len(set(drawn)) == 60
    assert env.reset(seed=3)[1]["parameters"]["lift_slope"] == drawn[0]
