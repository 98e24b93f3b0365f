"""Checks and defaults that the settings of all laws share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from controller.game.basis import Basis
from hfa_support.errors import BadInputError
from hfa_support.schema import Number

#: Weights beyond this overflow when they are squared twice.
LARGEST_WEIGHT = 1e60
#: More recorded samples than this fill the memory, and add nothing.
MOST_SAMPLES = 100_000


def checked(settings: Any, numbers: Mapping[str, Number], counts: Mapping[str, int]) -> None:
    """BadInputError unless the settings named are such numbers, and whole numbers from 1 to what is given.

    A count of None follows from the size of the basis (`enough_for`).
    """
    for name, declared in numbers.items():
        if declared.of(value := getattr(settings, name)) is None:
            raise BadInputError(f"{name} is {value}; give {declared}")
    for name, most in counts.items():
        value = getattr(settings, name)
        if value is not None and not (
            isinstance(value, (int, np.integer)) and value is not True and 1 <= value <= most
        ):
            raise BadInputError(f"{name} is {value}; give a whole number from 1 to {most}")


def enough_for(weights: int, least: int) -> int:
    """How many samples are taken for M weights where no number is given: `least`, or half as many again as weights."""
    return max(least, weights + (weights + 1) // 2)


def sample_counts(samples: int | None, pool_samples: int | None, basis: Basis) -> tuple[int, int]:
    """N_h and the size of the pool that it is chosen from, each as given or enough for the basis: 50 of 500 or more."""
    chosen = enough_for(basis.size, 50) if samples is None else samples
    return chosen, max(500, 5 * chosen) if pool_samples is None else pool_samples


def initial_weights(value: Any, basis: Basis) -> np.ndarray:
    """W(0), (M,): a number stands for all weights. Raises BadInputError for another size or too large an entry."""
    weights = np.asarray(value, dtype=float)
    if weights.ndim == 0:
        weights = np.full(basis.size, float(weights))
    if weights.shape != (basis.size,):
        raise BadInputError(f"initial weights are {weights.shape}; basis '{basis.name}' has {basis.size} weights")
    usable = np.abs(weights) <= LARGEST_WEIGHT
    if not np.all(usable):
        worst = int(np.argmin(usable))
        raise BadInputError(f"initial weight {worst} is {weights[worst]}; it must not exceed {LARGEST_WEIGHT:g}")
    return weights
