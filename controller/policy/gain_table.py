"""Gains in a file, one or a table over the dihedral: scheduled in place of a law's, and proved."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from controller.game.array_file import PlantNames, file_scales, read_arrays, words
from controller.game.critic_file import load_critic
from hfa_model.aircraft import HFA
from hfa_support.errors import BadInputError, numbers_in, said_of
from hfa_support.linear_table import LinearTable
from hfa_support.model import Model
from hfa_support.reporting.fields import Shown

#: rad; an angle this close to an end of the table is the end.
_AT_THE_END = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Shown):
    """u = -K(η) x, K linear in η between the angles.

    dihedral_deg: (G,), increasing; G = 1: the same at every angle; of another model than the HFA the values of its
    scheduling variable. K: (G, m, n): the states of the linear model come first, in the model's units; behind them may
    come the positions of actuators. BadInputError when a shape, the order or a number is wrong.
    """

    dihedral_deg: np.ndarray
    K: np.ndarray
    model: Model = HFA

    def __post_init__(self) -> None:
        """Check the table once."""
        count, m, n = np.size(self.dihedral_deg), len(self.model.inputs), len(self.model.linear)
        if np.shape(self.K) not in ((count, m, n), (count, m, n + m)):
            raise BadInputError(f"K is {np.shape(self.K)}; with {count} angles it must be ({count}, {m}, {n})")
        if not all(np.all(np.isfinite(each)) for each in (self.dihedral_deg, self.K)):
            raise BadInputError("the table of gains holds a number that is not finite")
        if np.ndim(self.dihedral_deg) != 1 or count < 1 or np.any(np.diff(self.dihedral_deg) <= 0.0):
            raise BadInputError("dihedral_deg must be the angles of the table, increasing")

    def grid(self, dihedrals: np.ndarray) -> np.ndarray:
        """These values (angles in rad), increasing, with those of the table between them: where a schedule is given.

        BadInputError when they reach beyond the table, or when K takes more than the states.
        """
        n = len(self.model.linear)
        if self.K.shape[-1] != n:
            raise BadInputError(f"K has {self.K.shape[-1]} columns; a schedule that flies takes {n}, no memory")
        low, high = dihedrals[0], dihedrals[-1]
        own = np.radians(self.dihedral_deg) if self._in_degrees else self.dihedral_deg
        if len(own) == 1:
            return dihedrals
        if low < own[0] - _AT_THE_END or high > own[-1] + _AT_THE_END:
            say = partial(self.model.describe, self.model.schedule)
            raise BadInputError(
                f"the gains cover {say(own[0])} to {say(own[-1])}, not {say(low)} to {say(high)}; fly where they are"
            )
        inside = own[(own > low + _AT_THE_END) & (own < high - _AT_THE_END)]
        new = [angle for angle in inside if np.abs(dihedrals - angle).min() > _AT_THE_END]
        return np.sort([*dihedrals, *new])

    def at(self, dihedral: float) -> np.ndarray:
        """K, (m, n), at a dihedral, rad, or another value of the scheduling variable."""
        return LinearTable(self.dihedral_deg, self.K).at(np.degrees(dihedral) if self._in_degrees else dihedral)

    @property
    def _in_degrees(self) -> bool:
        return self.model.unit(self.model.schedule).startswith("rad")


def load_gains(path: Path, model: Model = HFA) -> GainTable:
    """K (m, n), or dihedral_deg (G,) and K (G, m, n), also as MATLAB stacks them, (m, n, G); of another model the key
    is its `schedule_key`.

    BadInputError, one line that names the file, also for a table whose `state_units` are not the model's.
    """
    stored, m, n = read_arrays(path), len(model.inputs), len(model.linear)
    key, plant = model.schedule_key, PlantNames(model.linear, tuple(model.inputs), model.units(model.linear))
    with said_of(path):
        K = numbers_in("K", stored["K"]) if "K" in stored else np.zeros(0)
        if K.ndim != 3:
            found = load_critic(path, plant).K if "K" in stored else None
            if found is None or found.shape != (m, n):
                raise BadInputError(f"there is no K of {m} x {n}, nor {key} and K at each of its values")
            return GainTable(np.zeros(1), found[None], model)
        if key not in stored:
            raise BadInputError(f"there is no {key}; a table of gains K holds the value of each")
        places = np.ravel(numbers_in(key, stored[key]))
        if places.size < 2:
            raise BadInputError(f"{key} must be at least two values, increasing")
        if (K.shape[0], K.shape[2]) == (m, places.size) and K.shape[:2] != (places.size, m):
            K = np.moveaxis(K, -1, 0)
        units = words(stored, "state_units")[:n]
        if np.any(file_scales({"state_units": units}, plant) != 1.0):
            raise BadInputError(f"its states are in {', '.join(units)}; give them in {', '.join(plant.state_units)}")
        return GainTable(places, K, model)
