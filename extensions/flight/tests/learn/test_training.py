"""PPO of Stable-Baselines3 learns to hold the flexible aircraft in its default environment."""

import copy

import numpy as np
import pytest

import hfa

stable_baselines3 = pytest.importorskip("stable_baselines3")


@pytest.mark.slow
def test_ppo_holds_the_flexible_aircraft():
    """After 100,000 steps, 95 of 100 episodes stay for 10 s, at half the cost without action."""
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    env = hfa.environment(hfa.aircraft(), seconds=10.0)
    flights = VecNormalize(DummyVecEnv([lambda: copy.deepcopy(env)] * 16))
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
    # Mean returns of the same 100 episodes with the trained policy and without action.
    returns = {}
    for name in ("trained", "none"):
        totals, terminated = np.zeros(100), np.zeros(100, dtype=bool)
        for number in range(100):
            observed, _ = env.reset(seed=number)
            truncated = False
            while not (truncated or terminated[number]):
                action, _ = policy.predict(flights.normalize_obs(observed), deterministic=True)
                action = action if name == "trained" else 0.0 * action
                observed, reward, terminated[number], truncated, _ = env.step(action)
                totals[number] += reward
        returns[name] = totals.mean()
        if name == "trained":
            assert terminated.sum() <= 5
    assert returns["trained"] > 0.5 * returns["none"]
