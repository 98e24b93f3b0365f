"""Limits of the signals of a model, and the decision whether a value is within its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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
    low: (k,), highest values that count as at the lowest limit, nan without a limit
    high: (k,), lowest values that count as at the highest limit, nan without a limit
    assumed: (k,), whether no data of the aircraft and no user state the limits
    """

    model: Model
    names: tuple[str, ...]
    lowest: np.ndarray
    highest: np.ndarray
    least: np.ndarray
    most: np.ndarray
    low: np.ndarray
    high: np.ndarray
    assumed: np.ndarray

    @staticmethod
    def of(
        model: Model,
        names: Sequence[str],
        changes: Mapping[str, tuple[float, float]] | None = None,
    ) -> Limits:
        """Return the limits of the named signals of a model.

        changes: name -> (lowest, highest), instead of the declared min and max; None for no changes
        """
        # The tolerances are relative to the size of a limit, nominal + |limit|: a limit may be 0.
        rows = []  # each with the fields of `Limits` in their order
        for name in names:
            signal = model.signal(name)
            declared = (signal.min, signal.max)
            low_end, high_end = (changes or {}).get(name, declared)
            low_size, high_size = (signal.nominal + abs(end) for end in (low_end, high_end))
            within = (low_end - SLACK * low_size, high_end + SLACK * high_size)
            at_limit = (low_end + NEAR * low_size, high_end - NEAR * high_size)
            is_assumed = signal.assumed and (low_end, high_end) == declared
            rows.append((low_end, high_end, *within, *at_limit, is_assumed))
        lowest, highest, least, most, low, high, assumed = np.array(rows).reshape(-1, 7).T
        are_assumed = assumed.astype(bool)
        return Limits(model, tuple(names), lowest, highest, least, most, low, high, are_assumed)

    def within(self, values: np.ndarray | Sequence[float]) -> np.ndarray:
        """Return the mask of the values (..., k) that are within their limits, up to `SLACK`.

        The mask is False for nan.
        """
        array = np.asarray(values)
        return (array >= self.least) & (array <= self.most)

    def at_limits(self, values: np.ndarray | Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """Return masks of the values (..., k) at or beyond their lowest and their highest limit.

        A value within `NEAR` of a limit is at the limit.
        """
        array = np.asarray(values)
        return array <= self.low, array >= self.high

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
