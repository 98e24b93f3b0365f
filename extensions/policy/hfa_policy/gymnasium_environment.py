"""One episode of an aircraft as an `Env` of gymnasium."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from hfa_aircraft.model import Model
from hfa_policy.episodes import Episodes
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError, numbers_in, refuse_unless_whole, shown
from trim.point.operating_point import OperatingPoint

_FIRST = np.array([0])
_OBSERVED = np.dtype(np.float32)


class AircraftEnvironment(gymnasium.Env):
    """An aircraft about its trims: observation, action, timing and cost as in a deployment.

    Actions beyond the box are clipped. `info` contains `X`, `U` and the number of the trim. When an
    episode leaves the envelope, `left` names the state, its limit and the time.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, episodes: Episodes, render_mode: str | None = None) -> None:
        """Wrap the simulation of one episode."""
        self.episodes = episodes
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise BadInputError(f"render_mode is {shown(render_mode)}; give None or 'rgb_array'")
        self.render_mode = render_mode
        self.observation_space = observation_space(episodes.deployed.deployment.width)
        self.action_space = action_space(episodes)
        self._flown: list[tuple[np.ndarray, np.ndarray]] = []
        self._trim = 0
        self._X = episodes.states[0]
        self._U = episodes.inputs[0]
        self._frame = episodes.frames[0]
        self._outcome = episodes.outcomes[0]

    @property
    def model(self) -> Model:
        """The aircraft."""
        return self.episodes.deployed.model

    @property
    def dt(self) -> float:
        """Seconds between two samples."""
        return self.episodes.deployed.deployment.dt

    @property
    def point(self) -> OperatingPoint:
        """The trim of the episode."""
        return self.episodes.points[self._trim]

    @property
    def state(self) -> dict[str, float]:
        """State -> value, in the units of the model."""
        return dict(zip(self.model.states, self._X.tolist(), strict=True))

    @property
    def seconds(self) -> float:
        """Length of an episode, s."""
        return self.episodes.samples * self.dt

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Names or formulas of the observations, in order; with a history those of one sample."""
        return tuple(self.episodes.deployed.deployment.observation)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the inputs that the actions move, in order."""
        return tuple(self.episodes.deployed.deployment.action)

    @checks_arguments
    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Restart from a random state about a random trim, or from options={"start": X, "trim":
        number}."""
        super().reset(seed=seed)
        if options and "start" in options:
            owners = np.array([self._trim_number(options.get("trim", 0))])
            starts = self._start(options["start"])[None]
            observations = self.episodes.begin_at(_FIRST, owners, starts)
        else:
            observations = self.episodes.begin(_FIRST, self.np_random)
        self._trim = int(self.episodes.owners[0])
        info = self._info()
        self._flown = [(info["X"], info["U"])]
        return observations[0].astype(np.float32), info

    def _trim_number(self, number: Any) -> int:
        """Return the number of a trim. Raises BadInputError if there is no such trim."""
        count = len(self.episodes.points)
        refuse_unless_whole("options: trim", number, 0)
        if number >= count:
            raise BadInputError(
                f"options: trim is {number}; there are {count} trims, numbered from 0"
            )
        return int(number)

    def _start(self, start: Any) -> np.ndarray:
        """Return a state as floats, (n,). Raises BadInputError for anything else."""
        states = numbers_in("options: start", start)
        wanted = self.episodes.states.shape[1:]
        if states.shape != wanted or not np.isfinite(states).all():
            raise BadInputError(f"options: start is {shown(start)}; give {wanted[0]} finite states")
        return states

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance the episode by one sample."""
        if type(action) is not np.ndarray or action.dtype.kind != "f":
            action = numbers_in("an action", action)
        self.episodes.advance(action[None])
        reward, lost, over = self._outcome.tolist()
        info = self._info()
        if self.render_mode is not None:
            self._flown.append((info["X"], info["U"]))
        if lost:
            info["left"] = self.episodes.left(0)
        return self._frame.astype(_OBSERVED), reward, lost > 0.0, over > 0.0, info

    def render(self) -> np.ndarray | None:
        """Return the picture of the episode so far, (height, width, 3), or None without a render
        mode."""
        if self.render_mode is None:
            return None
        from hfa_policy.episode_figure import episode_picture

        return episode_picture(self.episodes, self._trim, self._flown)

    def _info(self) -> dict[str, Any]:
        return {"X": self._X.copy(), "U": self._U.copy(), "trim": self._trim}


def observation_space(observed: int) -> spaces.Box:
    """Return the unbounded box of observations."""
    return spaces.Box(-np.inf, np.inf, (observed,), np.float32)


def action_space(episodes: Episodes) -> spaces.Box:
    """Return the box of the actions."""
    return spaces.Box(
        episodes.low.astype(np.float32), episodes.high.astype(np.float32), dtype=np.float32
    )
