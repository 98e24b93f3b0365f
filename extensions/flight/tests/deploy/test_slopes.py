"""Command of a deployment file and its slopes, compared with Stable-Baselines3 in float64."""

import json
import pickle

import numpy as np
import pytest
from policy_cases import FOLDER, aircraft, stored_deployment

from hfa_flight import Deployed

SLOPES = json.loads((FOLDER / "slopes.json").read_text())


@pytest.mark.parametrize("name", SLOPES)
def test_actions_and_slopes_equal_stored_references(name):
    """Actions and slopes of the policies equal stored values of the PyTorch modules in float64."""
    import casadi as ca

    act = Deployed(stored_deployment(name), aircraft(name)).act
    o = ca.MX.sym("o", act.numel_in(0))
    slope = ca.Function("slope", [o], [ca.jacobian(act(o), o)])
    assert len(SLOPES[name]) == 5
    for entry in SLOPES[name]:
        observation = np.array(entry["observation"])
        action = np.array(act(observation)).ravel()
        np.testing.assert_allclose(action, entry["action"], rtol=0, atol=1e-12)
        expected = np.array(entry["slope"])
        found = np.array(slope(observation))
        np.testing.assert_allclose(found, expected, atol=1e-10 * max(1.0, np.abs(expected).max()))


def slopes(name, count=5):
    """Return observations, actions and their slopes, computed with Stable-Baselines3 in float64."""
    import stable_baselines3 as sb3
    import torch

    algorithm = getattr(sb3, name.partition("_")[0].upper())
    policy = algorithm.load(FOLDER / f"{name}.zip", device="cpu").policy.double()
    stored = None
    if (FOLDER / f"{name}.pkl").exists():
        stored = pickle.loads((FOLDER / f"{name}.pkl").read_bytes())
    low = torch.tensor(policy.action_space.low.astype(float))
    high = torch.tensor(policy.action_space.high.astype(float))

    def action(observation):
        if stored is not None:
            deviation = torch.sqrt(torch.tensor(stored.obs_rms.var) + stored.epsilon)
            observation = (observation - torch.tensor(stored.obs_rms.mean)) / deviation
            observation = torch.clamp(observation, -stored.clip_obs, stored.clip_obs)
        row = observation[None]
        if algorithm in (sb3.PPO, sb3.A2C):
            mean = policy.action_net(policy.mlp_extractor.forward_actor(row))[0]
            if not policy.squash_output:
                return torch.clamp(mean, low, high)
            squashed = torch.tanh(mean)
        elif algorithm is sb3.SAC:
            squashed = torch.tanh(policy.actor.mu(policy.actor.latent_pi(row)))[0]
        else:
            squashed = policy.actor.mu(row)[0]
        return low + 0.5 * (squashed + 1.0) * (high - low)

    random = np.random.default_rng(0)
    rows = []
    for _ in range(count):
        observation = torch.tensor(random.uniform(-0.05, 0.05, policy.observation_space.shape[0]))
        slope = torch.autograd.functional.jacobian(action, observation)
        entries = {"observation": observation, "action": action(observation).detach()}
        entries["slope"] = slope
        rows.append({key: value.tolist() for key, value in entries.items()})
    return rows
