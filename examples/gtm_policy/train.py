"""Train a policy on the GTM for a deployment file in this folder, and write its zip and normalizer.

    python train.py on_time.toml

Training takes minutes and requires `pip install ".[training]"`.
"""

import copy
import sys
from pathlib import Path

import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import hfa

HERE = Path(__file__).parent
steps = int(sys.argv[2]) if len(sys.argv) > 2 else 250_000
model = hfa.load_model(f"{HERE.parent}/gtm.py:GTM")
speeds = np.arange(40.0, 57.0, 4.0)  # m/s
trims = [hfa.trim(model, hold={"speed": speed}) for speed in speeds]
deployment = hfa.Deployment.load(HERE / sys.argv[1])  # observations, actions, timing, cost
env = hfa.environment(model, deployment, trims, seconds=8.0)
flights = DummyVecEnv([lambda: copy.deepcopy(env)] * 32)
normalized = VecNormalize(flights, gamma=0.98)
ppo = PPO(
    "MlpPolicy",
    normalized,
    n_steps=128,
    batch_size=512,
    gamma=0.98,
    learning_rate=lambda left: 1e-3 * left,
    policy_kwargs={"net_arch": [32, 32], "log_std_init": -1.0},
    seed=1,
)
ppo.learn(steps)
ppo.save(HERE / deployment.policy["file"])
normalized.save(HERE / deployment.policy["normalizer"])
