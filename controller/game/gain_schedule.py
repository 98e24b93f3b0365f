"""Gains in a file, one or a table over the scheduling variable: scheduled in place of a law's, and
proved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.user_files import PlantNames, file_scales, words
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, checked_matrix
from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, numbers_in, said_of
from hfa_support.linear_table import LinearTable
from hfa_support.reporting.fields import Shown

#: Values of the scheduling variable this close to an end of the table are the end.
_AT_THE_END = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Shown):
    """u = -K(η) x, K linear in η between the places.

    places: (G,), increasing, values of the scheduling variable of the model, angles in degrees; G =
    1: the same everywhere. K: (G, m, n): the states of the linear model come first, in the model's
    units; behind them may come the positions of actuators. BadInputError when a shape, the order or
    a number is wrong."""

    places: np.ndarray
    K: np.ndarray
    model: Model

    def __post_init__(self) -> None:
        """Check the table once."""
        count, m, n = np.size(self.places), len(self.model.inputs), len(self.model.linear)
        if np.shape(self.K) not in ((count, m, n), (count, m, n + m)):
            raise BadInputError(
                f"K is {np.shape(self.K)}; with {count} values it must be ({count}, {m}, {n})"
            )
        if not all(np.all(np.isfinite(each)) for each in (self.places, self.K)):
            raise BadInputError("the table of gains holds a number that is not finite")
        if np.ndim(self.places) != 1 or count < 1 or np.any(np.diff(self.places) <= 0.0):
            raise BadInputError(
                f"{self.model.schedule_key} must be the values of the table, increasing"
            )

    @property
    def table(self) -> LinearTable:
        """K over the scheduling variable, angles in rad."""
        in_degrees = self.model.schedule_unit == "deg"
        return LinearTable(np.radians(self.places) if in_degrees else self.places, self.K)

    def grid(self, places: np.ndarray) -> np.ndarray:
        """These values (angles in rad), increasing, with those of the table between them: where a
        schedule is given.

        BadInputError when they reach beyond the table, or when K takes more than the states.
        """
        n, own = len(self.model.linear), self.table.places
        if self.K.shape[-1] != n:
            raise BadInputError(
                f"K has {self.K.shape[-1]} columns; a schedule that flies takes {n}, no memory"
            )
        if len(own) == 1:
            return places
        if places[0] < own[0] - _AT_THE_END or places[-1] > own[-1] + _AT_THE_END:
            low, high, first, last = (
                self.model.describe(self.model.schedule, each)
                for each in (own[0], own[-1], places[0], places[-1])
            )
            raise BadInputError(
                f"the gains cover {low} to {high}, not {first} to {last}; fly where they are"
            )
        inside = own[(own > places[0] + _AT_THE_END) & (own < places[-1] - _AT_THE_END)]
        new = [place for place in inside if np.abs(places - place).min() > _AT_THE_END]
        return np.sort([*places, *new])


def load_gains(path: Path, model: Model) -> GainTable:
    """K (m, n), or the values of the scheduling variable (G,) under the model's `schedule_key` and
    K (G, m, n), also as MATLAB stacks them, (m, n, G).

    BadInputError, one line that names the file, also for a table whose `state_units` are not the
    model's."""
    stored, m, n = read_arrays(path), len(model.inputs), len(model.linear)
    key, plant = (
        model.schedule_key,
        PlantNames(model.linear, tuple(model.inputs), model.units(model.linear)),
    )
    with said_of(path):
        K = numbers_in("K", stored["K"]) if "K" in stored else np.zeros(0)
        if K.ndim != 3:
            if K.shape != (m, n):
                raise BadInputError(
                    f"there is no K of {m} x {n}, nor {key} and K at each of its values"
                )
            gain = checked_matrix("K", K, LARGEST_CRITIC_ENTRY) * file_scales(stored, plant)
            return GainTable(np.zeros(1), gain[None], model)
        if key not in stored:
            raise BadInputError(f"there is no {key}; a table of gains K holds the value of each")
        places = np.ravel(numbers_in(key, stored[key]))
        if places.size < 2:
            raise BadInputError(f"{key} must be at least two values, increasing")
        if (K.shape[0], K.shape[2]) == (m, places.size) and K.shape[:2] != (places.size, m):
            K = np.moveaxis(K, -1, 0)
        units = words(stored, "state_units")[:n]
        if np.any(file_scales({"state_units": units}, plant) != 1.0):
            raise BadInputError(
                f"its states are in {', '.join(units)}; give them in {', '.join(plant.state_units)}"
            )
        return GainTable(places, K, model)
