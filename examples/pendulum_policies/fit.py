"""Fit a small policy of each algorithm to the exact gain of the pendulum, and write its file.

    python fit.py

Requires `pip install ".[training]" sb3_contrib onnx onnxscript`. The policies observe the
deviations of the states and command the torque. `td3.onnx` and `td3.cleanrl_model` contain the
policy of `td3.zip`.
"""

from pathlib import Path

import torch
from sb3_contrib import ARS, TRPO
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3

import hfa

HERE = Path(__file__).parent
model = hfa.load_model(f"{HERE.parent}/pendulum.py:UPRIGHT")
linear = hfa.linearize(model, hfa.trim(model))
K = torch.tensor(hfa.solve(hfa.game(linear, Q=[10.0, 1.0], R=[1.0])).K, dtype=torch.float32)
largest = model.inputs["torque"].max
deployment = hfa.Deployment(
    policy={},
    observation={"angle": {}, "rate": {}},
    action={"torque": {"box": [-largest, largest]}},
    timing={"dt": 0.02},
)
environment = hfa.environment(model, deployment)

torch.manual_seed(1)
z = (2.0 * torch.rand(2000, 2) - 1.0) * torch.tensor([0.3, 1.0])
wanted = (-z @ K.T).clamp(-largest, largest)


def fitted(algorithm):
    """Return a model of Stable-Baselines3 whose policy was fitted to the exact gain."""
    if algorithm is ARS:
        learner = ARS("LinearPolicy", environment, seed=1)
    else:
        learner = algorithm("MlpPolicy", environment, policy_kwargs={"net_arch": [8, 8]}, seed=1)

    def torque():
        """Return the mean torque that the policy commands at the samples."""
        if algorithm in (PPO, A2C, TRPO):
            return learner.policy.get_distribution(z).distribution.mean
        return learner.policy(z) if algorithm is ARS else largest * learner.actor(z)

    optimizer = torch.optim.Adam(learner.policy.parameters(), lr=0.01)
    for _ in range(2000):
        optimizer.zero_grad()
        ((torque() - wanted) ** 2).mean().backward()
        optimizer.step()
    return learner


def save_as_onnx(actor, path):
    """Write the actor of TD3, and the factor from [-1, 1] to the torque, as an ONNX graph."""
    factor = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.constant_(factor.weight, largest)
    torch.onnx.export(
        torch.nn.Sequential(actor.mu, factor), (z[:1],), path, output_names=["action"],
        external_data=False,
    )  # fmt: skip


def save_as_cleanrl(actor, path):
    """Write the actor of TD3 by the names of CleanRL."""
    tensors = {"action_scale": torch.tensor([[largest]]), "action_bias": torch.zeros(1, 1)}
    for name, layer in (("fc1", actor.mu[0]), ("fc2", actor.mu[2]), ("fc_mu", actor.mu[4])):
        tensors |= {f"{name}.{part}": each for part, each in layer.state_dict().items()}
    torch.save(tensors, path)


for algorithm in (PPO, A2C, TRPO, SAC, TD3, DDPG, ARS):
    learner = fitted(algorithm)
    learner.save(HERE / algorithm.__name__.lower())
    if algorithm is TD3:
        save_as_onnx(learner.actor, HERE / "td3.onnx")
        save_as_cleanrl(learner.actor, HERE / "td3.cleanrl_model")
