"""A table of gains over the dihedral, linear between its angles, and the loop that it closes."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from controller.game.array_file import read_arrays
from hfa_model.support.echo import shortened
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import INPUTS, LINEAR_STATES
from verification.balls.balls import exact, matrix, symmetric
from verification.balls.taylor import DihedralBox, TaylorForm
from verification.balls.trim_branch import ModelForms

if TYPE_CHECKING:
    from flint import arb_mat

_STATES = len(LINEAR_STATES)


@dataclass(frozen=True, eq=False)
class GainTable:
    """ζ' = (A x - B K ζ, 0) + N (A X ζ - B K ζ) + M ζ, ζ = (x, memory); K, M, N, X linear in η between the angles.

    dihedral_deg: (G,), increasing, G >= 2. K: (G, 5, n). M: (G, n, n), what ζ does by itself: of actuators and of a
    controller with memory. N: (G, n, 6), X: (G, 6, n): what accelerations do to it, measured with the states X ζ. All
    three are 0 unless given. n >= 6: the six states of the linear model come first. With n = 6 it is u = -K(η) x. The
    doubles of the table are the gains, exactly. BadInputError when a shape, the order or a number is wrong.
    """

    dihedral_deg: np.ndarray
    K: np.ndarray
    M: np.ndarray = field(default_factory=lambda: np.zeros(0))
    N: np.ndarray = field(default_factory=lambda: np.zeros(0))
    X: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        """Check the table once."""
        angles, count = self.dihedral_deg, np.size(self.dihedral_deg)
        if np.ndim(angles) != 1 or count < 2 or np.any(np.diff(angles) <= 0.0):
            raise BadInputError("a table of gains needs at least two dihedral angles, in increasing order")
        n = np.shape(self.K)[-1] if np.ndim(self.K) else 0
        shapes = {"M": (count, n, n), "N": (count, n, _STATES), "X": (count, _STATES, n)}
        for name, shape in shapes.items():
            if not getattr(self, name).size:
                object.__setattr__(self, name, np.zeros(shape))
        if n < _STATES or np.shape(self.K) != (count, len(INPUTS), n):
            want = f"({count}, {len(INPUTS)}, {_STATES} or more)"
            raise BadInputError(f"K has shape {np.shape(self.K)}; with {count} angles it must be {want}")
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise BadInputError(f"{name} has shape {np.shape(getattr(self, name))}; with this K it must be {shape}")
        if not all(np.all(np.isfinite(each)) for each in (angles, self.K, self.M, self.N, self.X)):
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

    def close(self, forms: ModelForms) -> tuple[TaylorForm, list[arb_mat]]:
        """The closed loop on a box that crosses no angle of the table, and what the parameters' errors add to it."""
        from flint import arb_mat

        box, n = forms.box, self.K.shape[-1]
        index = int(np.searchsorted(self.dihedral_deg, box.low, side="right")) - 1
        first, second = (exact(angle) for angle in self.dihedral_deg[index : index + 2].tolist())

        def affine(values: np.ndarray) -> tuple[arb_mat, arb_mat]:
            slope = (matrix(values[index + 1]) - matrix(values[index])) / (second - first)
            return matrix(values[index]) + (box.middle - first) * slope, slope

        (K, K_slope), (M, M_slope), (N, N_slope), (X, X_slope) = map(affine, (self.K, self.M, self.N, self.X))
        states = matrix(np.eye(_STATES, n))
        up, zero = states.transpose(), matrix(np.zeros((n, n)))
        steered = forms.B.times_affine(-K, -K_slope)
        loop = (forms.A.map(lambda part: part * states) + steered).map(lambda part: up * part)
        loop += TaylorForm((M, M_slope, zero), zero, box.radius)
        K_all, N_all, X_all = (a + symmetric(box.radius) * b for a, b in ((K, K_slope), (N, N_slope), (X, X_slope)))
        errors = [
            up * (each.A * states - each.B * K_all) + N_all * (each.A * X_all - each.B * K_all) for each in forms.errors
        ]
        if self.N.any():
            seen = (forms.A.times_affine(X, X_slope) + steered).map(arb_mat.transpose)
            loop += seen.times_affine(N.transpose(), N_slope.transpose()).map(arb_mat.transpose)
        return loop, errors


def load_table(path: Path) -> GainTable:
    """A table from .npz or .json with the keys dihedral_deg and K; BadInputError, one line that names the file."""
    if path.suffix.lower() not in (".json", ".npz"):
        raise BadInputError(f"{path}: the suffix {path.suffix!r} is not known; use .npz or .json")
    stored = read_arrays(path)
    try:
        angles, gains = (np.array(stored[key], dtype=float) for key in ("dihedral_deg", "K"))
        memory = [np.array(stored.get(key, ()), dtype=float) for key in ("M", "N", "X")]
    except KeyError as error:
        raise BadInputError(
            f"{path}: there is no {error.args[0]}; a table holds dihedral_deg, K and, of a loop with memory, M"
        ) from error
    except (ValueError, TypeError, OverflowError) as error:
        raise BadInputError(f"{path}: cannot be read as a table of gains ({shortened(str(error))})") from error
    try:
        return GainTable(angles, gains, *memory)
    except BadInputError as error:
        raise BadInputError(f"{path}: {error}") from error
