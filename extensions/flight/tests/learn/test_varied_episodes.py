"""Episodes of aircraft whose parameters are drawn at each reset."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from policy_cases import aircraft, trims

from hfa import BadInputError, Deployment, environment

pytest.importorskip("gymnasium")
MASS = (8.4, 10.3)
DEPLOYMENT = Deployment(
    policy={},
    observation={"pitch": {}, "load_factor": {}, "speed": {"scale": 10.0}},
    action={"elevator_center": {"box": [-1, 1], "map": "trim + 0.1 * a"}},
    timing={"dt": 0.02, "delay": 0.03},
    cost={"Q": {"pitch": 3.0, "load_factor": 2.0}, "R": {"elevator_center": 1.0}},
)


def flown(env: Any, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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


@pytest.mark.slow
def test_a_varied_episode_is_that_of_the_changed_aircraft_at_the_original_trim() -> None:
    """States and observations are those of an aircraft with the drawn mass and frozen trim values.

    The observations of the changed aircraft without frozen trim values differ, and its states do
    not.
    """
    model = aircraft("ppo_hfa")
    point = trims("ppo_hfa")[0]
    start = np.array(point.states) + 0.01
    states, observations, rewards = flown(
        environment(model, DEPLOYMENT, [point], vary={"panel_mass": (MASS[1], MASS[1])}), start
    )
    heavier = model.with_parameters(panel_mass=MASS[1])
    moved = replace(point, model=heavier, problem=None)
    load_factor = model.outputs_at(point.states, point.inputs, ("load_factor",))["load_factor"]
    frozen = DEPLOYMENT.changed(
        observation={
            "pitch": {"about": point["pitch"]},
            "load_factor": {"about": load_factor},
            "speed": {"about": point["speed"], "scale": 10.0},
        }
    )
    expected, seen, _ = flown(environment(heavier, frozen, [moved]), start)
    np.testing.assert_allclose(states, expected, rtol=1e-12)
    np.testing.assert_allclose(observations, seen, rtol=1e-6)
    _, shifted, others = flown(environment(heavier, DEPLOYMENT, [moved]), start)
    assert np.abs(observations - shifted)[:, 1].min() > 0.01
    assert np.abs(rewards - others).min() > 0.0


def test_each_reset_draws_between_the_limits() -> None:
    """Each of 200 resets draws another mass between the limits, reproducibly by the seed, and each
    of five simultaneous episodes, as those of a vector environment, its own.
    """
    env = environment(
        aircraft("ppo_hfa"), DEPLOYMENT, trims("ppo_hfa")[:1], vary={"panel_mass": MASS}
    )
    drawn = [env.reset(seed=3)[1]["parameters"]["panel_mass"]]
    drawn += [env.reset()[1]["parameters"]["panel_mass"] for _ in range(199)]
    assert MASS[0] <= min(drawn) < MASS[0] + 0.1 < MASS[1] - 0.1 < max(drawn) <= MASS[1]
    assert len(set(drawn)) == 200
    assert env.reset(seed=3)[1]["parameters"]["panel_mass"] == drawn[0]
    assert "parameters" not in environment(aircraft("ppo_hfa"), DEPLOYMENT).reset(seed=3)[1]
    one = env.episodes
    five = type(one)(one.deployed, one.points, 5, vary={"panel_mass": MASS})
    five.begin(np.arange(5), np.random.default_rng(0))
    column = list(one.deployed.model.parameters).index("panel_mass")
    assert len(set(five.parameters[:, column])) == 5


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ({"panel_weight": (1.0, 2.0)}, "unknown parameter 'panel_weight'"),
        ({"panel_mass": 0.1}, "give two numbers"),
        ({"panel_mass": (2.0, 1.0)}, "ascending order"),
        ({"panel_mass": (1.0, np.inf)}, "two finite numbers"),
        ({"panel_mass": (-1.0, 1.0)}, "give at least 0"),
    ],
)
def test_wrong_variations_are_refused(vary: Any, said: str) -> None:
    """An unknown name, a single number, exchanged limits and values beyond limits are refused."""
    with pytest.raises(BadInputError, match=said):
        environment(aircraft("ppo_hfa"), DEPLOYMENT, trims("ppo_hfa")[:1], vary=vary)
