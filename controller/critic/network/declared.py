"""What the file of a policy says besides its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.batch_simulation import saturated
from hfa_support.errors import BadInputError, is_finite, numbers_in
from hfa_support.reporting.results import Result, Vector

#: Suffixes of the files of networks.
SUFFIXES = (
    ".onnx",
    ".pkl",
    ".pt",
    ".pth",
    ".cleanrl_model",
    ".safetensors",
    ".zip",
)


@dataclass(frozen=True, eq=False)
class Normalizer(Result):
    """Normalizer o -> clip((o - mean) / sqrt(variance + epsilon), -clip, clip).

    mean: (k,)
    variance: (k,)
    epsilon: number added to each variance. The sums are positive
    clip: largest absolute value
    origin: name of the file or description of the source, for messages
    """

    mean: Vector
    variance: Vector
    epsilon: float = 1e-8  # as in VecNormalize
    clip: float = 10.0
    origin: str = "mean and variance"

    def __post_init__(self) -> None:
        """Raise BadInputError unless the values define a normalizer."""
        for name in ("mean", "variance"):
            values = np.atleast_1d(numbers_in(f"{name} of the normalizer", getattr(self, name)))
            if values.ndim != 1 or not np.all(np.isfinite(values)):
                raise BadInputError(
                    f"{name} of the normalizer is not a list of finite numbers; give one finite "
                    "number for each observation"
                )
            object.__setattr__(self, name, values)
        if self.mean.shape != self.variance.shape:
            raise BadInputError(
                f"the normalizer has {self.mean.size} means and {self.variance.size} variances; "
                "give one mean and one variance for each observation"
            )
        if not is_finite(self.epsilon) or np.any(self.variance + self.epsilon <= 0.0):
            raise BadInputError(
                f"epsilon of the normalizer is {self.epsilon}; give a finite epsilon such that "
                "every variance plus epsilon is positive"
            )
        if not self.clip > 0.0:
            raise BadInputError(f"clip of the normalizer is {self.clip}; give a number above 0")

    @property
    def deviation(self) -> np.ndarray:
        """Divisor of the observations, sqrt(variance + epsilon), (k,)."""
        return np.asarray(np.sqrt(self.variance + self.epsilon))

    def before_clip(self, observation: Any) -> Any:
        """Return the expression (o - mean) / deviation of observations o."""
        return (observation - ca.DM(self.mean)) / ca.DM(self.deviation)

    def of(self, observation: Any) -> Any:
        """Return the expression of the normalized observations."""
        return saturated(self.before_clip(observation), -self.clip, self.clip)


class ActionBox(NamedTuple):
    """Way from the output of a policy's network to its action.

    squash: "tanh": the output is clipped to ±clip_mean, and tanh maps it to the box; "linear":
        [-1, 1] is mapped to the box; "": the output is clipped to the box
    low, high: box of the actions, (m,) each, infinite without a limit; None if the file has no box
    clip_mean: largest absolute value before tanh
    """

    squash: str = ""
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    clip_mean: float = math.inf

    def of(self, output: Any) -> Any:
        """Return the expression of the actions, (m,)."""
        if self.low is None or self.high is None:
            return ca.tanh(output) if self.squash == "tanh" else output
        if not self.squash:
            return saturated(output, ca.DM(self.low), ca.DM(self.high))
        share = output  # in [-1, 1]
        if self.squash == "tanh":
            share = ca.tanh(saturated(output, -self.clip_mean, self.clip_mean))
        return ca.DM(self.low) + 0.5 * (share + 1.0) * ca.DM(self.high - self.low)

    def __str__(self) -> str:
        """Return a description, such as "tanh to [-1, 1]", or "" if the output is the action."""
        if self.low is None or self.high is None:
            return self.squash
        ends = np.unique(np.column_stack([self.low, self.high]), axis=0)
        box = ", ".join(f"[{low:g}, {high:g}]" for low, high in ends)
        words = {"tanh": "tanh to", "linear": "mapped from [-1, 1] to", "": "clipped to"}
        return f"{words[self.squash]} {box}"


class Declared(NamedTuple):
    """What the file of a policy says besides its numbers.

    algorithm: such as "PPO", or "" if the file does not state it
    network: words that select the tensors of the policy, or ""
    activation: between the layers, or None
    action: way from the network's output to the action
    normalizer: of the observations, or None
    is_normalized: whether the policy was trained behind a normalizer that the file lacks
    seen: least and largest number of observations that a normalizer of this training saw
    observations: names of the observations, () if the file has none
    inputs: number of observations, or 0 if the file does not state it
    notes: sentences on what the file contains and the policy does not use
    other_game: sentence on entries of the file that differ from those of the game, or ""
    assumed: sentence on weights of the game that nothing gives, or ""
    """

    algorithm: str = ""
    network: str = ""
    activation: str | None = None
    action: ActionBox = ActionBox()
    normalizer: Normalizer | None = None
    is_normalized: bool = False
    seen: tuple[float, float] = (0.0, math.inf)
    observations: tuple[str, ...] = ()
    inputs: int = 0
    notes: tuple[str, ...] = ()
    other_game: str = ""
    assumed: str = ""


def notes_on_statistics(mean: np.ndarray, spread: np.ndarray) -> tuple[str, ...]:
    """Return a note on the running statistics of a normalizer that saw no data."""
    if np.any(mean) or np.any(spread != 1.0):
        return ()
    return ("the normalizer saw no data: its mean is 0 and its deviation 1",)


#: Of a file that states nothing.
NOTHING = Declared()
