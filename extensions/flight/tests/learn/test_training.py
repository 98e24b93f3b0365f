"""PPO of Stable-Baselines3 learns to hold the flexible aircraft in its default environment."""

from __future__ import annotations

import numpy as np
import pytest

import hfa

stable_baselines3 = pytest.importorskip("stable_baselines3")


@pytest.mark.slow
def test_ppo_holds_the_flexible_aircraft() -> None:
    """After 100,000 steps, 95 of 100 episodes stay for 10 s, at half the cost without action."""
    from stable_baselines3.common.vec_env import VecNormalize

    model = hfa.aircraft()
    flights = VecNormalize(hfa.vector_environment(model, count=16, seconds=10.0))
    policy = stable_baselines3.PPO(
        "MlpPolicy",
        flights,
        seed=0,
        n_steps=256,
        batch_size=512,
        learning_rate=1e-3,
        policy_kwargs={"log_std_init": -2.0},
    )
    policy.learn(100_000)
    dt = flights.venv.episodes.deployed.deployment.dt
    returns = {}
    for name in ("trained", "none"):
        episodes = hfa.vector_environment(model, count=100, seconds=10.0)
        episodes.seed(1)
        observed = episodes.reset()
        total, lost = np.zeros(100), np.zeros(100, dtype=bool)
        for _ in range(round(10.0 / dt)):
            action, _ = policy.predict(flights.normalize_obs(observed), deterministic=True)
            action = action if name == "trained" else 0.0 * action
            observed, rewards, _, infos = episodes.step(action)
            total += np.where(lost, 0.0, rewards)
            lost |= ["left" in info for info in infos]
        returns[name] = total.mean()
        assert lost.sum() <= 5
    assert returns["trained"] > 0.5 * returns["none"]
