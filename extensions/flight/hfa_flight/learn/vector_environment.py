"""Stable-Baselines3 `VecEnv` with many episodes of an aircraft."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from hfa_flight.learn.episodes import Episodes
from hfa_flight.learn.gymnasium_environment import action_space, observation_space
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import BadInputError, numbers_in, refuse_unless_whole


class AircraftVectorEnvironment(VecEnv):
    """Episodes that advance together and restart when they end."""

    def __init__(self, episodes: Episodes) -> None:
        self.episodes = episodes
        self.render_mode = None
        count = len(episodes.done)
        observed = observation_space(episodes.deployed.deployment.width)
        super().__init__(count, observed, action_space(episodes))
        self._random = np.random.default_rng()
        self._actions = np.zeros((count, len(episodes.low)))
        self._returns = np.zeros(count)
        self._began = time.monotonic()

    @property
    def deployment(self) -> Deployment:
        """Observations, actions, timing and cost of the environment, for the trained policy."""
        return self.episodes.deployment

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Set the seed of all later initial conditions, and return the seed once for each episode.

        Raises BadInputError unless the seed is a nonnegative integer or None.
        """
        if seed is not None:
            refuse_unless_whole("seed", seed, 0)
        self._random = np.random.default_rng(seed)
        return [seed] * self.num_envs

    def reset(self) -> np.ndarray:
        """Restart all episodes and return their observations, (N, k).

        Raises BadInputError if options were set.
        """
        if any(self._options):
            raise BadInputError(
                "reset: episodes that run together have no options; give an initial state to "
                "reset of hfa.environment"
            )
        if self._seeds[0] is not None:
            self._random = np.random.default_rng(self._seeds[0])
            self._reset_seeds()
        numbers = np.arange(self.num_envs)
        self._returns[:] = 0.0
        return self.episodes.begin(numbers, self._random).astype(np.float32)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions (N, m) for `step_wait`."""
        self._actions = numbers_in("actions", actions)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Advance all episodes by one sample and restart the episodes that ended.

        Returns observations, rewards, flags of ended episodes, and an `info` for each episode. For
        an ended episode, `info` contains the last observation, whether the duration elapsed, the
        episode's return and length, and the time since the environment was created. If the aircraft
        left its limits, `info` also contains the reason.
        """
        stepped = self.episodes.step(self._actions)
        observations = stepped.observations.astype(np.float32)
        ended = stepped.lost | stepped.over
        self._returns += stepped.rewards
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        numbers = np.flatnonzero(ended)
        for number in numbers.tolist():
            infos[number]["terminal_observation"] = observations[number].copy()
            infos[number]["TimeLimit.truncated"] = not stepped.lost[number]
            infos[number]["episode"] = {
                "r": float(self._returns[number]),
                "l": int(self.episodes.done[number]),
                "t": round(time.monotonic() - self._began, 6),
            }
        for number, text in stepped.left.items():
            infos[number]["left"] = text
        if numbers.size:
            self._returns[numbers] = 0.0
            observations[numbers] = self.episodes.begin(numbers, self._random)
        return observations, stepped.rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Do nothing, because no file or process is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return a list with the value of an attribute, once for each requested episode."""
        return [getattr(self, attr_name) for _ in self._of(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute that all episodes share. `indices` has no effect."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *arguments: Any, indices: Any = None, **options: Any
    ) -> list[Any]:
        """Call a method once for each requested episode, and return the list of results."""
        return [getattr(self, method_name)(*arguments, **options) for _ in self._of(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return a list with False for each requested episode: no episode is wrapped."""
        return [False for _ in self._of(indices)]

    def _of(self, indices: Any) -> Iterable[int]:
        return self._get_indices(indices)
