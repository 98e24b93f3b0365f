"""Imitate a predictive policy in the gymnasium environment of the flexible aircraft.

    python examples/imitate_a_planner.py

Flights of `hfa.predictive` give rows (observation, action). A linear policy is fitted to them by
least squares, and flown in the same environment from other initial states, beside no action. The
cost of an episode is the negative sum of its rewards.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import gymnasium
import numpy as np

import hfa

#: Fraction of the environment's box of initial states from which flights begin.
SHARE = 0.5


def begin_episode(env: gymnasium.Env, seed: int) -> tuple[np.ndarray, dict]:
    """Begin an episode near the trim, and return the observation and `info`."""
    aircraft: Any = env.unwrapped
    rng = np.random.default_rng(seed)
    state = {
        name: aircraft.point[name] + SHARE * rng.uniform(-half_width, half_width)
        for name, half_width in aircraft.start_box.items()
    }
    return env.reset(seed=seed, options={"state": state})


def planned_rows(env: gymnasium.Env, flights: int, steps: int = 100) -> tuple[np.ndarray, ...]:
    """Return the observations (N, 6) and actions (N, 5) of flights of the predictive policy."""
    aircraft: Any = env.unwrapped
    point = aircraft.point
    cost = aircraft.deployment.cost
    planner = hfa.predictive(
        aircraft.model, point, cost["Q"], cost["R"], dt=aircraft.dt, budget=math.inf
    )
    half_ranges = np.array([(each.max - each.min) / 2 for each in aircraft.model.inputs.values()])
    observations, actions = [], []
    for seed in range(flights):
        observation, info = begin_episode(env, seed)
        planner.reset()
        for _ in range(steps):
            inputs = planner(0.0, info["X"])
            # An action is the deviation from the trim, in half ranges of the input.
            action = np.clip((inputs - point.u) / half_ranges, -1.0, 1.0)
            observations.append(observation)
            actions.append(action)
            observation, _, is_lost, is_over, info = env.step(action.astype(np.float32))
            if is_lost or is_over:
                break
    return np.array(observations), np.array(actions)


def cost(env: gymnasium.Env, gain: np.ndarray, episodes: int = 10) -> float:
    """Return the mean cost of episodes of the policy a = gain z, from seeds not used to fit."""
    total = 0.0
    for seed in range(1000, 1000 + episodes):
        observation, _ = begin_episode(env, seed)
        is_lost = is_over = False
        while not (is_lost or is_over):
            action = np.clip(gain @ observation, -1.0, 1.0).astype(np.float32)
            observation, reward, is_lost, is_over, _ = env.step(action)
            total -= float(reward) / episodes
    return total


def main(flights: int = 5) -> tuple[float, float]:
    """Return the mean costs of the imitation and of no action."""
    model = hfa.aircraft()
    Q = {name: model.states[name].nominal ** -2 for name in model.linear}
    R = {name: signal.nominal**-2 for name, signal in model.inputs.items()}
    env = gymnasium.make("hfa.gym:hfa/Flexible-v0", points=[0.17], seconds=10.0, Q=Q, R=R)
    observations, actions = planned_rows(env, flights)
    gain = np.linalg.lstsq(observations, actions, rcond=None)[0].T
    return cost(env, gain), cost(env, 0.0 * gain)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, default=5)
    imitation, nothing = main(parser.parse_args().flights)
    print(f"mean cost of 10 episodes: imitation {imitation:.4g}, no action {nothing:.4g}")
