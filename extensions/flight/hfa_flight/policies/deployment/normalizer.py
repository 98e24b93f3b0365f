"""Normalizer of Stable-Baselines3 between observations and network."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from hfa_flight.policies.deployment.inert_pickle import Inert, inert
from hfa_support.errors import (
    BadInputError,
    file_faults,
    is_finite,
    numbers_in,
    prefix_errors,
)
from hfa_support.files import regular_file

#: Defaults of VecNormalize, for a deployment file with mean and variance only.
EPSILON = 1e-8
CLIP = 10.0


@dataclass(frozen=True, eq=False)
class Normalizer:
    """Normalizer o -> clip((o - mean) / sqrt(variance + epsilon), -clip, clip).

    mean: (k,).
    variance: (k,).
    epsilon: number added to each variance. The sums are positive.
    clip: largest absolute value.
    origin: name of the file or description of the source, for messages.
    """

    mean: np.ndarray
    variance: np.ndarray
    epsilon: float = EPSILON
    clip: float = CLIP
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

    def of_frames(self, count: int) -> Normalizer:
        """Return the normalizer for the observations of `count` samples."""
        means = np.tile(self.mean, count)
        variances = np.tile(self.variance, count)
        return replace(self, mean=means, variance=variances)

    @property
    def deviation(self) -> np.ndarray:
        """Divisor of the observations in the normalizer, sqrt(variance + epsilon), (k,)."""
        return np.asarray(np.sqrt(self.variance + self.epsilon))

    def before_clip(self, observation: Any) -> Any:
        """Return the expression (o - mean) / deviation of observations o."""
        return (observation - ca.DM(self.mean)) / ca.DM(self.deviation)


def read_normalizer(path: str | Path) -> Normalizer | None:
    """Read a normalizer from a file of `VecNormalize.save`, without executing its code.

    The result is None if the VecNormalize does not normalize observations. Raises a BadInputError
    that names the file and the fault if the file contains no normalizer of an array of
    observations.
    """
    with prefix_errors(path):
        with file_faults(path):
            content = regular_file(path).read_bytes()
        stored = inert(content)
        statistics = getattr(stored, "obs_rms", None)
        if not isinstance(stored, Inert) or not {"clip_obs", "epsilon"} <= vars(stored).keys():
            raise BadInputError(
                "the file does not contain a VecNormalize object; give a file written by "
                "VecNormalize.save"
            )
        if getattr(stored, "norm_obs", True) is False:
            return None
        if isinstance(statistics, dict):
            raise BadInputError(
                "the VecNormalize object normalizes a dictionary of observations, which is not "
                "supported; give mean and variance in the deployment file"
            )
        if statistics is None:
            raise BadInputError(
                "the VecNormalize object contains no obs_rms; give mean and variance in the "
                "deployment file"
            )
        attributes = vars(stored)
        seen = vars(statistics) if isinstance(statistics, Inert) else {}
        mean = numbers_in("its mean", seen.get("mean"))
        return Normalizer(
            mean=mean,
            variance=numbers_in("its var", seen.get("var")),
            epsilon=_number_in("epsilon", attributes),
            clip=_number_in("clip_obs", attributes),
            origin=Path(path).name,
        )


def _number_in(name: str, attributes: Mapping[str, Any]) -> float:
    """Return a number among the attributes of a stored VecNormalize object."""
    numbers = numbers_in(f"{name} of the VecNormalize object", attributes.get(name))
    if numbers.size != 1:
        raise BadInputError(
            f"{name} of the VecNormalize object is not one number; save the normalizer again"
        )
    return float(numbers.item())
