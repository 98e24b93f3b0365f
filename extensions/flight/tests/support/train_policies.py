"""Train the policies of `policies/` again, and write their outputs and slopes.

    python extensions/flight/tests/support/train_policies.py [NAME ...]

Each policy is trained according to its deployment file. The slopes are computed with the modules
of Stable-Baselines3 in float64. The package stable-baselines3 is required.
"""

import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import stable_baselines3 as sb3
import torch
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import hfa
from hfa_flight import Deployed

FOLDER = Path(__file__).resolve().parent.parent / "policies"
ROOT = FOLDER.parent.parent.parent.parent
GTM = f"{ROOT}/examples/gtm.py:GTM"
GTM_STARTS = {"speed": 5.0, "alpha": 0.08, "pitch_rate": 0.2, "pitch": 0.15}
C172_STARTS = {"speed": 10.0, "alpha": 0.05, "pitch_rate": 0.1, "pitch": 0.1, "roll": 0.2}
HFA_STARTS = {"speed": 3.0, "alpha": 0.03, "pitch": 0.05, "pitch_rate": 0.05, "dihedral": 0.03}
TANH, RELU = torch.nn.Tanh, torch.nn.ReLU
#: Name -> class, aircraft, trims, spread of the initial conditions, normalized, activation, layout,
#: steps.
PLANS = {
    "ppo_gtm": (sb3.PPO, GTM, (38, 45, 52, 60), GTM_STARTS, True, TANH, (16, 16), 60_000),
    "ppo_raw": (sb3.PPO, GTM, (45,), GTM_STARTS, False, RELU, (16, 16), 60_000),
    "sac_gtm": (sb3.SAC, GTM, (45,), GTM_STARTS, False, RELU, (16, 16), 9_000),
    "td3_gtm": (sb3.TD3, GTM, (45, 52), GTM_STARTS, True, TANH, (16, 16), 12_000),
    "a2c_gtm": (sb3.A2C, GTM, (45,), GTM_STARTS, True, TANH, (16,), 60_000),
    "ppo_c172": (sb3.PPO, "jsbsim:c172p", (120, 135, 150), C172_STARTS, True, TANH, (16, 16), 60_000),
    "ppo_hfa": (sb3.PPO, "hfa_model:MODEL", np.radians((8, 15)), HFA_STARTS, True, TANH, (16, 16), 60_000),
    "ppo_squash": (sb3.PPO, GTM, (45,), GTM_STARTS, True, TANH, (16,), 512),
    "sac_sde": (sb3.SAC, GTM, (45,), GTM_STARTS, False, RELU, (16,), 600),
}  # fmt: skip
#: Name -> settings of this policy only.
ALONE = {
    "ppo_squash": {"use_sde": True, "n_steps": 128, "policy_kwargs": {"squash_output": True}},
    "sac_sde": {"use_sde": True, "policy_kwargs": {}},
}
OF_ALGORITHM = {
    sb3.PPO: {"n_steps": 512, "batch_size": 256, "n_epochs": 8, "learning_rate": 1e-3},
    sb3.A2C: {"n_steps": 16},
    sb3.SAC: {"learning_starts": 500, "batch_size": 128, "learning_rate": 1e-3},
    sb3.TD3: {"learning_starts": 500, "batch_size": 128, "learning_rate": 1e-3},
}


def aircraft(name):
    return hfa.aircraft() if name.startswith("hfa_model") else hfa.load_model(name)


def held_sample(model, X, U, dt, parts=4):
    """Return the states after a sample with held inputs, by the Runge-Kutta method of order 4."""
    h = dt / parts
    for _ in range(parts):
        k1 = model.at(X, U).f
        k2 = model.at(X + 0.5 * h * k1, U).f
        k3 = model.at(X + 0.5 * h * k2, U).f
        k4 = model.at(X + h * k3, U).f
        X = X + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return X


class Flight(gymnasium.Env):
    """Ten seconds about a trim, as in the deployment file, with 1 minus the cost as reward."""

    def __init__(self, deployment, model, trims, spread):
        self.deployment = deployment
        self.deployed = Deployed(deployment, model)
        self.points = [hfa.trim(model, at=float(value)) for value in trims]
        self.spread = [spread.get(name, 0.0) for name in model.states]
        self.lowest = np.array([signal.min for signal in model.states.values()])
        self.highest = np.array([signal.max for signal in model.states.values()])
        self.Q = [deployment.cost["Q"].get(name, 0.0) for name in model.states]
        self.R = [deployment.cost["R"].get(name, 0.0) for name in model.inputs]
        low, high = deployment.box
        self.action_space = gymnasium.spaces.Box(low.astype("float32"), high.astype("float32"))
        size = (len(deployment.observation),)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, size, np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        point = self.points[self.np_random.integers(len(self.points))]
        self.trim = self.deployed.trim_vector(point)
        self.X0, self.U0 = np.array(point.states), np.array(point.inputs)
        start = self.X0 + self.np_random.uniform(-1.0, 1.0, len(self.X0)) * self.spread
        self.X = np.clip(start, self.lowest, self.highest)
        self.U = self.U0
        self.steps = 0
        return self.observation(), {}

    def observation(self):
        return np.array(self.deployed.observe(self.X, self.U, self.trim)).ravel().astype("float32")

    def step(self, action):
        action = np.clip(action, *self.deployment.box)
        model = self.deployed.model
        self.U = np.array(self.deployed.inputs(action, self.X, self.U, self.trim)).ravel()
        cost = self.Q @ (self.X - self.X0) ** 2 + self.R @ (self.U - self.U0) ** 2
        self.X = held_sample(model, self.X, self.U, self.deployment.dt)
        self.steps += 1
        lost = not ((self.lowest <= self.X) & (self.highest >= self.X)).all()
        if lost:
            self.X = np.clip(np.nan_to_num(self.X), self.lowest, self.highest)
        reward = float(1.0 - cost - 20.0 * lost)
        return self.observation(), reward, lost, self.steps * self.deployment.dt >= 10.0, {}


def train(name):
    algorithm, where, trims, spread, is_normalized, activation, layout, steps = PLANS[name]
    model = aircraft(where)
    deployment = replace(hfa.Deployment.load(FOLDER / f"{name}.toml"), policy={})
    count = 4 if algorithm in (sb3.PPO, sb3.A2C) else 1
    flights = DummyVecEnv([lambda: Flight(deployment, model, trims, spread)] * count)
    if is_normalized:
        flights = VecNormalize(flights, gamma=0.98)
    settings = {"policy_kwargs": {"net_arch": list(layout), "activation_fn": activation}}
    settings |= {"seed": 1, "gamma": 0.98, "device": "cpu", **OF_ALGORITHM[algorithm]}
    alone = ALONE.get(name, {"policy_kwargs": {}})
    settings |= alone | {"policy_kwargs": settings["policy_kwargs"] | alone["policy_kwargs"]}
    policy = algorithm("MlpPolicy", flights, **settings)
    policy.learn(steps)
    policy.save(FOLDER / f"{name}.zip")
    if is_normalized:
        flights.save(str(FOLDER / f"{name}.pkl"))


def slopes(name, count=5):
    """Return observations, actions and their slopes, computed with Stable-Baselines3 in float64."""
    algorithm, *_, is_normalized, _, _, _ = PLANS[name]
    policy = algorithm.load(FOLDER / f"{name}.zip", device="cpu").policy.double()
    stored = None
    if is_normalized:
        with open(FOLDER / f"{name}.pkl", "rb") as file:
            stored = pickle.load(file)
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


if __name__ == "__main__":
    torch.set_num_threads(1)
    for plan in sys.argv[1:]:
        train(plan)
    references = {name: slopes(name) for name in PLANS}
    (FOLDER / "slopes.json").write_text(json.dumps(references) + "\n")
