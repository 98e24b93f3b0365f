"""A table of gains over the dihedral, linear between its angles: ours, or one from a file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, LINEAR_STATES
from verification.proof.balls import exact, matrix
from verification.proof.taylor import DihedralBox

if TYPE_CHECKING:
    from flint import arb_mat

_SHAPE = (len(INPUTS), len(LINEAR_STATES))


@dataclass(frozen=True, eq=False)
class GainTable:
    """u = -K(η) x with K linear in η between the angles. dihedral_deg: (G,), increasing, G >= 2. K: (G, 5, 6).

    The doubles of the table are the gains, exactly. BadInputError when a shape, the order or a number is wrong.
    """

    dihedral_deg: np.ndarray
    K: np.ndarray

    def __post_init__(self) -> None:
        """Check the table once."""
        angles, count = self.dihedral_deg, np.size(self.dihedral_deg)
        if np.ndim(angles) != 1 or count < 2 or np.any(np.diff(angles) <= 0.0):
            raise BadInputError("a table of gains needs at least two dihedral angles, in increasing order")
        if np.shape(self.K) != (count, *_SHAPE):
            raise BadInputError(f"K has shape {np.shape(self.K)}; with {count} angles it must be {(count, *_SHAPE)}")
        if not (np.all(np.isfinite(angles)) and np.all(np.isfinite(self.K))):
            raise BadInputError("the table of gains holds a number that is not finite")

    def segments(self, low: float, high: float) -> list[DihedralBox]:
        """The interval, cut at the angles of the table, degrees. BadInputError when the table does not reach."""
        first, last = float(self.dihedral_deg[0]), float(self.dihedral_deg[-1])
        if low < first or high > last:
            raise BadInputError(
                f"the table covers {first:g} to {last:g} deg, not {low:g} to {high:g} deg; prove it where it is"
            )
        cuts = [low, *(angle for angle in self.dihedral_deg.tolist() if low < angle < high), high]
        return [DihedralBox(a, b) for a, b in pairwise(cuts)]

    def affine_on(self, box: DihedralBox) -> tuple[arb_mat, arb_mat]:
        """K at the middle of a box that crosses no angle of the table, and its slope, 1/deg."""
        index = int(np.searchsorted(self.dihedral_deg, box.low, side="right")) - 1
        first, second = (exact(angle) for angle in self.dihedral_deg[index : index + 2].tolist())
        slope = (matrix(self.K[index + 1]) - matrix(self.K[index])) / (second - first)
        return matrix(self.K[index]) + (box.middle - first) * slope, slope


def load_table(path: Path) -> GainTable:
    """A table from .npz or .json with the keys dihedral_deg and K; BadInputError, one line that names the file."""
    if not path.is_file():
        raise BadInputError(f"{path}: there is no such file")
    readers = {".json": _read_json, ".npz": _read_npz}
    if path.suffix.lower() not in readers:
        raise BadInputError(f"{path}: the suffix {path.suffix!r} is not known; use .npz or .json")
    try:
        stored = readers[path.suffix.lower()](path)
        angles, gains = (np.array(stored[key], dtype=float) for key in ("dihedral_deg", "K"))
    except KeyError as error:
        raise BadInputError(f"{path}: there is no {error.args[0]}; a table holds dihedral_deg and K") from error
    except Exception as error:  # a damaged file makes the readers raise nearly anything
        raise BadInputError(f"{path}: cannot be read as a table of gains ({str(error).splitlines()[0]})") from error
    try:
        return GainTable(angles, gains)
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error


def _read_json(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8")))


def _read_npz(path: Path) -> dict[str, Any]:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        return {key: archive[key] for key in archive.files}
