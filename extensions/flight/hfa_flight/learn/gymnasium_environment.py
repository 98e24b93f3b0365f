"""Episodes of an aircraft as a gymnasium `Env`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from hfa_aircraft.model import Model
from hfa_flight.judge.flight_costs import cost_weights
from hfa_flight.learn.episode import Episode
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.simulate.envelope import flight_envelope
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown, refuse_unless_whole, shown
from trim.point.operating_point import OperatingPoint

_OPTIONS = ("state", "trim")


class AircraftEnvironment(gymnasium.Env):
    """Aircraft about its trims, with observation, action, timing and cost of a deployment.

    `info` contains `X`, `U`, the index of the trim and, with varied parameters, their drawn values
    `parameters`. If the aircraft leaves its limits, `info["left"]` reports the reason and the time.

    A copy (`copy.deepcopy`, pickle) continues at the same sample.
    """

    metadata = {"render_modes": []}  # noqa: RUF012

    def __init__(self, episode: Episode) -> None:
        """Prepare the environment of the simulation `episode`."""
        self.episode = episode
        observed = len(episode.observation)
        self.observation_space = spaces.Box(-np.inf, np.inf, (observed,), np.float32)
        low, high = (limit.astype(np.float32) for limit in (episode.low, episode.high))
        self.action_space = spaces.Box(low, high, dtype=np.float32)
        self._under_way = False

    @property
    def model(self) -> Model:
        """The aircraft."""
        return self.episode.deployed.model

    @property
    def dt(self) -> float:
        """Sample time, s."""
        return self.episode.deployed.deployment.dt

    @property
    def deployment(self) -> Deployment:
        """Observations, actions and timing for the trained policy, with the cost of the reward."""
        deployed = self.episode.deployed
        Q, R = cost_weights(deployed)
        return deployed.deployment.changed(cost={"Q": dict(Q), "R": dict(R)})

    @property
    def start_box(self) -> dict[str, float]:
        """Half-widths of the initial conditions about the trim of the present episode, by name."""
        return self.episode.start_box

    @property
    def point(self) -> OperatingPoint:
        """Trim of the present episode."""
        return self.episode.points[self.episode.trim_index]

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode and return the observation (k,) and `info`.

        The initial state is random, about a random trim. options={"state": X} sets it instead: all
        states (n,), or some by name with the others at the trim. {"state": X, "trim": index} also
        selects the trim; the default is 0.

        Raises BadInputError for other options, for a wrong state or trim, and for a state beyond
        the limits.
        """
        super().reset(seed=seed)
        options = options or {}
        for name in options:
            refuse_unknown("reset: unknown option", name, _OPTIONS)
        if options and "state" not in options:
            raise BadInputError("options: trim requires an initial state; add a state")
        if options:
            number = self._trim_number(options.get("trim", 0))
            start = self._start(options["state"], self.episode.points[number])
            self.episode.begin_at(number, start, self.np_random)
        else:
            self.episode.begin(self.np_random)
        self._under_way = True
        return self._observation(), self._info()

    def _trim_number(self, number: Any) -> int:
        """Return a trim's index as an integer. Raises BadInputError if no trim has this index."""
        count = len(self.episode.points)
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
        wanted = point.x.shape
        if states.shape != wanted or not np.isfinite(states).all():
            raise BadInputError(
                f"options: state is {shown(given)}; give {wanted[0]} finite "
                "numbers, one for each state, or some by name"
            )
        envelope = flight_envelope(self.model, point)
        for sentence in envelope.broken(states, verb="is"):
            raise BadInputError(f"options: state: {sentence}; give a state within the limits")
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
            action = numbers_in("the action", action)
        reward, left, over = self.episode.advance(action)
        self._under_way = not (left or over)
        info = self._info()
        if left:
            info["left"] = self.episode.left()
        return self._observation(), reward, left, over, info

    def render(self) -> None:
        """Raise BadInputError, which states how to draw a flight."""
        raise BadInputError(
            "render: the environment draws nothing; hfa.fly(model, point, policy).figure() draws a "
            "flight, and info has X and U of each sample"
        )

    def _observation(self) -> np.ndarray:
        """Return the observations of the sample in single precision, (k,)."""
        return self.episode.observation.astype(np.float32)

    def _info(self) -> dict[str, Any]:
        """Return the entries of `info` that every sample has."""
        episode = self.episode
        info: dict[str, Any] = {
            "X": episode.states,
            "U": episode.inputs,
            "trim": episode.trim_index,
        }
        if episode.varied:
            info["parameters"] = episode.parameters
        return info
