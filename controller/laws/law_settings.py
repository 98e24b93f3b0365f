"""Checks and defaults that the settings of all laws share."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.game.basis import Basis
from hfa_support.errors import BadInputError

#: Weights beyond this overflow when they are squared twice.
LARGEST_WEIGHT = 1e60
#: More recorded samples than this fill the memory, and add nothing.
MOST_SAMPLES = 100_000


def positive(name: str, value: float) -> None:
    """Raise BadInputError unless the setting is a finite number above 0."""
    if not (_is_number(value) and np.isfinite(value) and value > 0.0):
        raise BadInputError(f"{name} is {value}; it must be a positive number")


def counting(name: str, value: int | None, most: int | None = None) -> None:
    """Raise BadInputError unless the setting is a whole number of at least 1, and of at most `most`.

    None is a number that follows from the size of the basis (`enough_for`).
    """
    if value is None:
        return
    if not (isinstance(value, (int, np.integer)) and not isinstance(value, bool) and value >= 1):
        raise BadInputError(f"{name} is {value}; it must be a whole number of at least 1")
    if most is not None and value > most:
        raise BadInputError(f"{name} is {value}; it must not exceed {most}")


def enough_for(weights: int, least: int) -> int:
    """How many samples are taken for M weights where no number is given: `least`, or half as many again as weights."""
    return max(least, weights + (weights + 1) // 2)


def sample_counts(samples: int | None, pool_samples: int | None, basis: Basis) -> tuple[int, int]:
    """N_h and the size of the pool that it is chosen from, each as given or enough for the basis: 50 of 500 or more."""
    chosen = enough_for(basis.size, 50) if samples is None else samples
    return chosen, max(500, 5 * chosen) if pool_samples is None else pool_samples


def recorded(settings: Any, step: str) -> None:
    """Raise BadInputError unless what laws on recorded samples have in common can run.

    settings: predefined_time and the one called `step`, s; eta and theta in (0, 1); samples and pool_samples.
    """
    length, end = getattr(settings, step), settings.predefined_time
    positive("predefined_time", end)
    positive(step, length)
    for name in ("eta", "theta"):
        value = getattr(settings, name)
        if not (_is_number(value) and 0.0 < value < 1.0):
            raise BadInputError(f"{name} is {value}; it must lie between 0 and 1, both excluded")
    counting("samples", settings.samples)
    counting("pool_samples", settings.pool_samples, MOST_SAMPLES)
    if length > end:
        raise BadInputError(f"{step} is {length} s; it must not exceed the predefined time {end} s")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)


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
