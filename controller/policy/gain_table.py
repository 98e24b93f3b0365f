"""Gains in a file, one or a table over the dihedral: scheduled in place of a law's, and proved."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from controller.game.array_file import PlantNames, file_scales, read_arrays, words
from controller.game.critic_file import load_critic
from hfa_model.vectors import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.errors import BadInputError, numbers_in, said_of
from hfa_support.linear_table import LinearTable
from hfa_support.reporting.fields import Shown

_STATES = len(LINEAR_STATES)
_PLANT = PlantNames(LINEAR_STATES, INPUTS, LINEAR_UNITS)
#: rad; an angle this close to an end of the table is the end.
_AT_THE_END = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class GainTable(Shown):
    """ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ, ζ = (x, memory); K, M, N, X linear in η between the angles.

    dihedral_deg: (G,), increasing; G = 1: the same at every angle. K: (G, 5, n). M: (G, n, n), what ζ does by itself:
    of actuators and of a controller with memory. N: (G, n, 6), X: (G, 6, n): what accelerations do to it, measured with
    the states X ζ. All three are 0 unless given. n >= 6: the six states of the linear model come first, in ft, s, rad.
    With n = 6 it is u = -K(η) x. The doubles of the table are the gains, exactly. BadInputError when a shape, the order
    or a number is wrong.
    """

    dihedral_deg: np.ndarray
    K: np.ndarray
    M: np.ndarray = field(default_factory=lambda: np.zeros(0))
    N: np.ndarray = field(default_factory=lambda: np.zeros(0))
    X: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Check the table once."""
        count, n = np.size(self.dihedral_deg), np.shape(self.K)[-1] if np.ndim(self.K) else 0
        shapes = {"M": (count, n, n), "N": (count, n, _STATES), "X": (count, _STATES, n)}
        for name, shape in shapes.items():
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros(shape))
        if n < _STATES or np.shape(self.K) != (count, len(INPUTS), n):
            want = f"({count}, {len(INPUTS)}, {_STATES})"
            raise BadInputError(f"K is {np.shape(self.K)}; with {count} angles it must be {want}, or wider with memory")
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise BadInputError(f"{name} is {np.shape(getattr(self, name))}; with this K it must be {shape}")
        if not all(np.all(np.isfinite(each)) for each in (self.dihedral_deg, self.K, self.M, self.N, self.X)):
            raise BadInputError("the table of gains holds a number that is not finite")
        if np.ndim(self.dihedral_deg) != 1 or count < 1 or np.any(np.diff(self.dihedral_deg) <= 0.0):
            raise BadInputError("dihedral_deg must be the angles of the table, increasing")

    def grid(self, dihedrals: np.ndarray) -> np.ndarray:
        """These angles, increasing, rad, with those of the table between them: where a schedule of K is given.

        BadInputError when they reach beyond the table, or when the loop of the table has a memory.
        """
        if self.K.shape[-1] != _STATES:
            raise BadInputError(f"K has {self.K.shape[-1]} columns; a schedule that flies takes {_STATES}, no memory")
        low, high, own = dihedrals[0], dihedrals[-1], np.radians(self.dihedral_deg)
        if len(own) == 1:
            return dihedrals
        if low < own[0] - _AT_THE_END or high > own[-1] + _AT_THE_END:
            low, high, first, last = (np.degrees(each) for each in (low, high, own[0], own[-1]))
            raise BadInputError(
                f"the gains cover {first:g} to {last:g} deg, not {low:g} to {high:g} deg; fly where they are"
            )
        inside = own[(own > low + _AT_THE_END) & (own < high - _AT_THE_END)]
        new = [angle for angle in inside if np.abs(dihedrals - angle).min() > _AT_THE_END]
        return np.sort([*dihedrals, *new])

    def at(self, dihedral: float) -> np.ndarray:
        """K, (5, n), at a dihedral, rad."""
        return LinearTable(self.dihedral_deg, self.K).at(np.degrees(dihedral))


def load_gains(path: Path) -> GainTable:
    """K (5, 6), or dihedral_deg (G,) and K (G, 5, n), also as MATLAB stacks them, (5, n, G); of a memory M, N and X.

    BadInputError, one line that names the file, also for a table whose `state_units` are not ft/s and rad.
    """
    stored = read_arrays(path)
    with said_of(path):
        parts = {name: numbers_in(name, stored[name]) for name in "KMNX" if name in stored}
        if "K" not in parts or parts["K"].ndim != 3:
            K = load_critic(path, _PLANT).K if "K" in stored else None
            if K is None or K.shape != (len(INPUTS), _STATES):
                raise BadInputError("there is no K of 5 x 6, nor dihedral_deg and K at each of its angles")
            return GainTable(np.zeros(1), K[None])
        if "dihedral_deg" not in stored:
            raise BadInputError("there is no dihedral_deg; a table of gains K holds the angle of each")
        degrees = np.ravel(numbers_in("dihedral_deg", stored["dihedral_deg"]))
        if degrees.size < 2:
            raise BadInputError("dihedral_deg must be at least two angles, increasing")
        first, second, last = parts["K"].shape
        if (first, last) == (len(INPUTS), degrees.size) and (first, second) != (degrees.size, len(INPUTS)):
            parts = {name: np.moveaxis(each, -1, 0) for name, each in parts.items()}
        units = words(stored, "state_units")[:_STATES]
        if np.any(file_scales({"state_units": units}, _PLANT) != 1.0):
            raise BadInputError(f"its states are in {', '.join(units)}; give them in {', '.join(LINEAR_UNITS)}")
        return GainTable(degrees, **parts)
