"""Limits of the signals of a model, and the decision whether a value is within its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from hfa_aircraft.model import Model

#: Tolerance beyond a limit, as a fraction of (nominal size + |limit|). It covers the rounding of a
#: trim, whose equations balance to 1e-10 of their scales.
SLACK = 1e-9
#: Distance from a limit below which a value is at the limit, as a fraction of the same quantity. An
#: interior-point search stops up to 1e-8 from an active limit, and sheets print six digits.
NEAR = 1e-6


@dataclass(frozen=True, eq=False)
class Limits:
    """Lowest and highest values of k named signals, in the units of their model.

    model: model of the signals
    names: (k,), states, inputs, outputs or parameters
    lowest: (k,), -inf without a limit
    highest: (k,), inf without a limit
    least: (k,), lowest values that count as within, `lowest` minus a tolerance
    most: (k,), highest values that count as within, `highest` plus a tolerance
    """

    model: Model
    names: tuple[str, ...]
    lowest: np.ndarray
    highest: np.ndarray
    least: np.ndarray
    most: np.ndarray

    @staticmethod
    def of(
        model: Model,
        names: Sequence[str],
        changes: Mapping[str, tuple[float, float]] | None = None,
    ) -> Limits:
        """Return the limits of the named signals of a model.

        changes: name -> (lowest, highest), instead of the declared min and max; None for no changes
        """
        changed = [(name, lowest, highest) for name, (lowest, highest) in (changes or {}).items()]
        return _limits(model, tuple(names), tuple(changed))

    @property
    def assumed(self) -> np.ndarray:
        """Mask (k,) of the limits that no data of the aircraft and no user states."""
        are_assumed = []
        for name, lowest, highest in zip(self.names, self.lowest, self.highest, strict=True):
            signal = self.model.signal(name)
            is_declared = (signal.min, signal.max) == (lowest, highest)
            are_assumed.append(signal.assumed and is_declared)
        return np.array(are_assumed)

    def within(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Return the mask of the values (..., k) that are within their limits, up to `SLACK`.

        The mask is False for nan.
        """
        array = np.asarray(values)
        return (array >= self.least) & (array <= self.most)

    def at_lowest(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Return the mask of the values (..., k) at or below their lowest limit, up to `NEAR`."""
        return np.asarray(values) <= self.lowest + NEAR * self._measure(self.lowest)

    def at_highest(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Return the mask of the values (..., k) at or above their highest limit, up to `NEAR`."""
        return np.asarray(values) >= self.highest - NEAR * self._measure(self.highest)

    def between(self, name: str) -> str:
        """Return the limits of one signal as text: "-60 deg and 60 deg"."""
        index = self.names.index(name)
        lowest = self.model.describe(name, self.lowest[index])
        highest = self.model.describe(name, self.highest[index])
        return f"{lowest} and {highest}"

    def broken(
        self, values: np.ndarray | Sequence[float], verb: str = "would have to be"
    ) -> list[str]:
        """Return an error sentence for each of the values (k,) that is not within its limits.

        verb: word between the name of the signal and its value, such as "is"
        """
        sentences = []
        for index in np.flatnonzero(~self.within(values)).tolist():
            name = self.names[index]
            sentences.append(
                f"{name} {verb} {self.model.describe(name, values[index])}, but must lie between "
                f"{self.between(name)}"
            )
        return sentences

    def _measure(self, limit: np.ndarray) -> np.ndarray:
        """Return nominal + |limit| of each signal, 0 where it has no limit, (k,)."""
        nominal = self.model.nominal(self.names)
        return np.where(np.isfinite(limit), nominal + np.abs(limit), 0.0)


@lru_cache(maxsize=64)
def _limits(
    model: Model, names: tuple[str, ...], changes: tuple[tuple[str, float, float], ...]
) -> Limits:
    """Return the limits of the named signals, with changes as (name, lowest, highest)."""
    changed = {name: (lowest, highest) for name, lowest, highest in changes}
    rows = []
    for name in names:
        signal = model.signal(name)
        lowest, highest = changed.get(name, (signal.min, signal.max))
        least = lowest - SLACK * (signal.nominal + abs(lowest))
        most = highest + SLACK * (signal.nominal + abs(highest))
        rows.append((lowest, highest, least, most))
    return Limits(model, names, *np.array(rows).reshape(-1, 4).T)
