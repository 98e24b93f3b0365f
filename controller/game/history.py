"""A critic or a gain, once or over time, as a learner has written it down, whoever's it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controller.game.array_file import real_array
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown

#: Entries of a critic beyond this overflow when P S P is squared, and mean nothing.
LARGEST_CRITIC_ENTRY = 1e50


class StoredCritic(NamedTuple):
    """What a file says about a controller: weights W (M,), a value matrix P (n, n), a gain K (m, n); not all None."""

    W: np.ndarray | None
    P: np.ndarray | None
    K: np.ndarray | None


@dataclass(frozen=True, eq=False, repr=False)
class History(Shown):
    """times: (N,), s, increasing. W: (N, M) weights in `basis`, P: (N, n, n), K: (N, m, n); at least one of them.

    A single W (M,), P (n, n) or K (m, n) belongs to the last row alone. BadInputError when a number is not finite or
    too large, the times do not increase from 0 on, or the number of rows differs.
    """

    times: np.ndarray
    W: np.ndarray | None = None
    P: np.ndarray | None = None
    K: np.ndarray | None = None
    basis: str = "quadratic"

    def __post_init__(self) -> None:
        """Name the first row that is wrong."""
        object.__setattr__(self, "times", real_array("time", self.times))
        for name in ("W", "P", "K"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, real_array(name, getattr(self, name)))
        if self.times.ndim != 1 or not len(self.times):
            raise BadInputError(f"time has shape {self.times.shape}; give one time for each row")
        _refuse("time", self.times, np.isfinite(self.times), "is not finite")
        late = np.flatnonzero(np.diff(self.times) <= 0.0)
        if len(late):
            row = int(late[0]) + 1
            before, after = self.times[row - 1 : row + 1].tolist()
            raise BadInputError(f"time goes from {before:g} to {after:g} s at row {row + 1}; it must increase")
        _refuse("time", self.times, self.times >= 0.0, "is negative, and a predefined time counts from 0,")
        if not self._over_time():
            raise BadInputError("a history needs W (rows of weights), P or K (a matrix for each time)")
        for name, values in self._over_time().items():
            if len(values) != len(self.times):
                raise BadInputError(f"{name} has {len(values)} rows and there are {len(self.times)} times")
            flat = values.reshape(len(values), -1)
            _refuse(name, self.times, np.isfinite(flat).all(axis=1), "is not finite")
            small = np.abs(flat).max(axis=1, initial=0.0) <= LARGEST_CRITIC_ENTRY
            _refuse(name, self.times, small, f"has an entry beyond {LARGEST_CRITIC_ENTRY:g}")

    def row(self, index: int) -> StoredCritic:
        """What is known at one time."""
        found = self._over_time()
        return StoredCritic(*(found[name][index] if name in found else None for name in StoredCritic._fields))

    @property
    def last(self) -> StoredCritic:
        """The last row, with the P and K that belong to it alone."""
        found = self._over_time()
        return StoredCritic(
            *(found[name][-1] if name in found else getattr(self, name) for name in StoredCritic._fields)
        )

    def _over_time(self) -> dict[str, np.ndarray]:
        given = {"W": (self.W, 2), "P": (self.P, 3), "K": (self.K, 3)}
        return {name: values for name, (values, ndim) in given.items() if values is not None and values.ndim == ndim}


def _refuse(name: str, times: np.ndarray, good: np.ndarray, what: str) -> None:
    if not good.all():
        row = int(np.argmin(good))
        raise BadInputError(f"{name} {what} at row {row + 1} (t = {times[row]:g} s)")
