"""Gains in a file, one or a table over the dihedral: what is scheduled in place of a law's."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.file_units import file_scales
from controller.game.history import real_array
from controller.game.model_file import load_critic
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, LINEAR_STATES, UNITS

_SHAPE = len(INPUTS), len(LINEAR_STATES)
_UNITS = tuple(UNITS[name] for name in LINEAR_STATES)
#: rad; an angle this close to an end of the table is the end.
_AT_THE_END = 1e-9


class StoredGains(NamedTuple):
    """u = -K(η) z: gains K (G, 5, 6) at dihedrals (G,), rad, increasing, linear in between; of one gain G = 1."""

    dihedrals: np.ndarray
    gains: np.ndarray

    def grid(self, dihedrals: np.ndarray) -> np.ndarray:
        """These angles, increasing, rad, with those of the table between them.

        BadInputError when they reach beyond the table.
        """
        low, high = dihedrals[0], dihedrals[-1]
        first, last = self.dihedrals[0], self.dihedrals[-1]
        if len(self.dihedrals) == 1:
            return dihedrals
        if low < first - _AT_THE_END or high > last + _AT_THE_END:
            low, high, first, last = (np.degrees(each) for each in (low, high, first, last))
            raise BadInputError(
                f"the gains cover {first:g} to {last:g} deg, not {low:g} to {high:g} deg; fly where they are"
            )
        inside = self.dihedrals[(self.dihedrals > low + _AT_THE_END) & (self.dihedrals < high - _AT_THE_END)]
        new = [angle for angle in inside if np.abs(dihedrals - angle).min() > _AT_THE_END]
        return np.sort([*dihedrals, *new])

    def at(self, dihedral: float) -> np.ndarray:
        """K, (5, 6), at a dihedral, rad."""
        share = np.array([np.interp(dihedral, self.dihedrals, column) for column in np.eye(len(self.dihedrals))])
        return np.asarray(np.tensordot(share, self.gains, axes=1))


def load_gains(path: Path) -> StoredGains:
    """K (5, 6), or dihedral_deg (G,) and K (G, 5, 6), also as MATLAB stacks them, (5, 6, G).

    A file whose `state_units` are SI is converted. BadInputError, one line that names the file.
    """
    stored = read_arrays(path)
    try:
        gains = real_array("K", stored["K"]) if "K" in stored else np.zeros(0)
        if gains.ndim != 3:
            K = load_critic(path, _UNITS).K
            if K is None or K.shape != _SHAPE:
                raise BadInputError(
                    f"a schedule takes K, {_SHAPE[0]} x {_SHAPE[1]}, or dihedral_deg and K at each of its angles"
                )
            return StoredGains(np.zeros(1), K[None])
        if "dihedral_deg" not in stored:
            raise BadInputError("there is no dihedral_deg; a table of gains K holds the angle of each")
        degrees = np.ravel(real_array("dihedral_deg", stored["dihedral_deg"]))
        gains = np.moveaxis(gains, -1, 0) if gains.shape == (*_SHAPE, degrees.size) else gains
        if gains.shape != (degrees.size, *_SHAPE):
            raise BadInputError(f"K is {gains.shape}; with {degrees.size} angles it must be {(degrees.size, *_SHAPE)}")
        if not (np.all(np.isfinite(gains)) and np.all(np.isfinite(degrees))):
            raise BadInputError("the table holds a number that is not finite")
        if degrees.size < 2 or np.any(np.diff(degrees) <= 0.0):
            raise BadInputError("dihedral_deg must be at least two angles, increasing")
        return StoredGains(np.radians(degrees), gains * file_scales(stored, _UNITS))
    except BadInputError as error:
        text = str(error)
        raise BadInputError(text if text.startswith(str(path)) else f"{path}: {text}") from error
