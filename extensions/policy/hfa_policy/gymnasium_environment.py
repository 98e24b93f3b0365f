"""One episode of an aircraft as an `Env` of gymnasium."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from hfa_policy.episodes import Episodes
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, numbers_in, refuse_unless_whole, shown

_FIRST = np.array([0])


class AircraftEnvironment(gymnasium.Env):
    """An aircraft about its trims: observation, action, timing and cost as a deployment says.

    Actions beyond the box count as at its end. `info` has `X`, `U` and the number of the trim; at
    the end of an episode that leaves the envelope `left` names the state, its limit and the time.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, episodes: Episodes, render_mode: str | None = None) -> None:
        """episodes: of one episode."""
        self.episodes = episodes
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise BadInputError(f"render_mode is {shown(render_mode)}; give None or 'rgb_array'")
        self.render_mode = render_mode
        self.observation_space = observation_space(episodes.deployed.deployment.width)
        self.action_space = action_space(episodes)
        self._flown: list[tuple[np.ndarray, np.ndarray]] = []

    @checks_arguments
    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin at a random trim from a random start; with options={"start": X, "trim": number}
        from that state."""
        super().reset(seed=seed)
        if options and "start" in options:
            owners = np.array([self._trim_number(options.get("trim", 0))])
            starts = self._start(options["start"])[None]
            observations = self.episodes.begin_at(_FIRST, owners, starts)
        else:
            observations = self.episodes.begin(_FIRST, self.np_random)
        self._flown = []
        self._remember()
        return observations[0].astype(np.float32), self._info()

    def _trim_number(self, number: Any) -> int:
        """The number of a trim of the episodes; BadInputError where there is none."""
        count = len(self.episodes.points)
        refuse_unless_whole("options: trim", number, 0)
        if number >= count:
            raise BadInputError(f"options: trim is {number}; there are {count} trims, from 0 on")
        return int(number)

    def _start(self, start: Any) -> np.ndarray:
        """A state as floats, (n,); BadInputError where it is something else."""
        states = numbers_in("options: start", start)
        wanted = self.episodes.states.shape[1:]
        if states.shape != wanted or not np.isfinite(states).all():
            raise BadInputError(f"options: start is {shown(start)}; give {wanted[0]} finite states")
        return states

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One sample."""
        stepped = self.episodes.step(numbers_in("an action", action)[None])
        self._remember()
        info = self._info()
        if stepped.lost[0]:
            info["left"] = stepped.left[0]
        return (
            stepped.observations[0].astype(np.float32),
            float(stepped.rewards[0]),
            bool(stepped.lost[0]),
            bool(stepped.over[0]),
            info,
        )

    def render(self) -> np.ndarray | None:
        """The picture of the episode so far, (height, width, 3)."""
        if self.render_mode is None:
            return None
        from hfa_policy.episode_figure import episode_picture

        owner = int(self.episodes.owners[0])
        return episode_picture(self.episodes, owner, self._flown)

    def _remember(self) -> None:
        if self.render_mode is not None:
            self._flown.append((self.episodes.states[0], self.episodes.inputs[0]))

    def _info(self) -> dict[str, Any]:
        return {
            "X": self.episodes.states[0],
            "U": self.episodes.inputs[0],
            "trim": int(self.episodes.owners[0]),
        }


def observation_space(observed: int) -> spaces.Box:
    """Any numbers."""
    return spaces.Box(-np.inf, np.inf, (observed,), np.float32)


def action_space(episodes: Episodes) -> spaces.Box:
    """The box of the deployment."""
    return spaces.Box(
        episodes.low.astype(np.float32), episodes.high.astype(np.float32), dtype=np.float32
    )
