"""One episode of an aircraft as a gymnasium `Env`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from hfa_aircraft.model import Model
from hfa_flight.learn.episodes import Episodes
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown, refuse_unless_whole, shown
from trim.point.operating_point import OperatingPoint

_FIRST = np.array([0])
_OPTIONS = ("state", "trim")
_OBSERVED = np.dtype(np.float32)


class AircraftEnvironment(gymnasium.Env):
    """Aircraft about its trims, with observation, action, timing and cost of a deployment.

    `info` contains `X`, `U`, the index of the trim and, with varied parameters, their drawn values
    `parameters`. If the aircraft leaves its limits, `info["left"]` reports the reason and the time.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012

    def __init__(self, episodes: Episodes, render_mode: str | None = None) -> None:
        """Prepare the environment.

        episodes: simulation of a single episode
        render_mode: None or "rgb_array". Another mode raises BadInputError
        """
        self.episodes = episodes
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise BadInputError(f"render_mode is {shown(render_mode)}; give None or 'rgb_array'")
        self.render_mode = render_mode
        self.observation_space = observation_space(episodes.deployed.deployment.width)
        self.action_space = action_space(episodes)
        self._flown: list[tuple[np.ndarray, np.ndarray]] = []
        self._under_way = False
        self._trim = 0
        self._drawn: dict[str, float] = {}
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
        """Sample time, s."""
        return self.episodes.deployed.deployment.dt

    @property
    def deployment(self) -> Deployment:
        """Observations, actions, timing and cost of the environment, for the trained policy."""
        return self.episodes.deployment

    @property
    def start_box(self) -> dict[str, float]:
        """Half-widths of the initial conditions about the trim of the present episode, by name."""
        return self.episodes.start_box(self._trim)

    @property
    def point(self) -> OperatingPoint:
        """Trim of the present episode."""
        return self.episodes.points[self._trim]

    @property
    def state(self) -> dict[str, float]:
        """Present values of the aircraft's states, by name, in the units of the model."""
        return dict(zip(self.model.states, self._X.tolist(), strict=True))

    @property
    def seconds(self) -> float:
        """Longest duration of an episode, s."""
        return self.episodes.samples * self.dt

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode and return the observation (k,) and `info`.

        The initial state is random, about a random trim. options={"state": X} sets it instead: all
        states (n,), or some by name with the others at the trim. {"state": X, "trim": index} also
        selects the trim; the default is 0.

        Raises BadInputError for other options, and for a wrong state or trim.
        """
        super().reset(seed=seed)
        options = options or {}
        for name in options:
            refuse_unknown("reset: unknown option", name, _OPTIONS)
        if options and "state" not in options:
            raise BadInputError("options: trim requires an initial state; add a state")
        if options:
            number = self._trim_number(options.get("trim", 0))
            starts = self._start(options["state"], self.episodes.points[number])[None]
            owners = np.array([number])
            observations = self.episodes.begin_at(_FIRST, owners, starts, self.np_random)
        else:
            observations = self.episodes.begin(_FIRST, self.np_random)
        self._under_way = True
        self._trim = int(self.episodes.owners[0])
        values = dict(zip(self.model.parameters, self.episodes.parameters[0], strict=True))
        self._drawn = {name: float(values[name]) for name in self.episodes.varied}
        info = self._info()
        self._flown = [(info["X"], info["U"])]
        return observations[0].astype(np.float32), info

    def _trim_number(self, number: Any) -> int:
        """Return a trim's index as an integer. Raises BadInputError if no trim has this index."""
        count = len(self.episodes.points)
        refuse_unless_whole("options: trim", number, 0)
        if number >= count:
            raise BadInputError(
                f"options: trim is {number}, but the last trim has the index {count - 1}; give "
                "the index of a trim"
            )
        return int(number)

    def _start(self, given: Any, point: OperatingPoint) -> np.ndarray:
        """Return an initial state as an array (n,)."""
        if isinstance(given, Mapping):
            for name in given:
                refuse_unknown("options: state names the unknown state", name, self.model.states)
            given = [*{**point.states._asdict(), **given}.values()]
        states = numbers_in("options: state", given)
        wanted = self.episodes.states.shape[1:]
        if states.shape != wanted or not np.isfinite(states).all():
            raise BadInputError(
                f"options: state is {shown(given)}; give {wanted[0]} finite "
                "numbers, one for each state, or some by name"
            )
        return states

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """Advance the episode by one sample.

        Returns observation, reward, whether the aircraft left its limits, whether the duration has
        elapsed, and `info`.

        action: (m,), clipped to the box

        Raises BadInputError if the action has another shape, contains NaN, or does not consist of
        numbers, and if no episode is under way.
        """
        if not self._under_way:
            raise BadInputError("step: no episode is under way; call reset() first")
        if type(action) is not np.ndarray or action.dtype.kind != "f":
            action = numbers_in("an action", action)
        self.episodes.advance(action[None])
        reward, lost, over = self._outcome.tolist()
        self._under_way = not (lost or over)
        info = self._info()
        if self.render_mode is not None:
            self._flown.append((info["X"], info["U"]))
        if lost:
            info["left"] = self.episodes.left(0)
        return self._frame.astype(_OBSERVED), reward, lost > 0.0, over > 0.0, info

    def render(self) -> np.ndarray | None:
        """Return the picture of the episode so far, (height, width, 3).

        The result is None without a render_mode.
        """
        if self.render_mode is None:
            return None
        from hfa_flight.learn.environment import episode_picture

        return episode_picture(self.episodes, self._trim, self._flown)

    def _info(self) -> dict[str, Any]:
        info: dict[str, Any] = {"X": self._X.copy(), "U": self._U.copy(), "trim": self._trim}
        if self._drawn:
            info["parameters"] = dict(self._drawn)
        return info


def observation_space(observed: int) -> spaces.Box:
    """Return the space of vectors of `observed` numbers without bounds."""
    return spaces.Box(-np.inf, np.inf, (observed,), np.float32)


def action_space(episodes: Episodes) -> spaces.Box:
    """Return the Box of the actions."""
    return spaces.Box(
        episodes.low.astype(np.float32), episodes.high.astype(np.float32), dtype=np.float32
    )
