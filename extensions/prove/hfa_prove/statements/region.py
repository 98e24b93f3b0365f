"""Statement of a certificate about a region of attraction or an invariant set, and its witness.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_prove.fields import Fields, Stated, Statement, entry, part, require
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import check_limits_of_model

#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 100_000_000


def _read_extents(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    """Return state -> lowest and highest deviation, of which one is negative, one positive."""
    listed = file.fields(name)
    extents = {state: listed.pair(state) for state in known.loop.states}
    listed.close()
    require(all(low < 0.0 < high for low, high in extents.values()), "extents", extents)
    return extents


@dataclass(frozen=True, eq=False)
class RegionStatement(Statement):
    """Claim that the trajectories from a set converge to the equilibrium of a closed loop.

    Every trajectory of the loop that begins in the set exists for all time, stays in the set and
    within all limits, and converges to the equilibrium. With disturbances, convergence is not
    claimed. z are the deviations from the equilibrium.

    loop: the model with its policy and saturated inputs
    equilibrium: moving state -> value, within `SAME_TRIM` nominal values of the proved equilibrium
    piece: the set {V <= rho, |y_i| < 1}, y = M z
    extents: moving state -> lower and upper bound of the deviation in the set
    """

    loop: Loop = part(Loop)
    equilibrium: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, known.loop.states)
    )
    piece: Piece = entry(
        lambda file, name, known: Piece.read(file.fields(name), len(known.loop.states)),
        store=Piece.content,
    )
    extents: Mapping[str, tuple[float, float]] = entry(_read_extents)

    def check_consistent(self) -> None:
        """Raise Malformed unless the limits are admissible for the model."""
        check_limits_of_model(self.loop)

    @property
    def rho(self) -> float:
        """Level of V that defines the set."""
        return self.piece.c

    @property
    def degree(self) -> int:
        """Degree of V."""
        return max(sum(powers) for _, powers in self.piece.W.terms)


def _read_multipliers(file: Fields, name: str, known: Any) -> np.ndarray:
    multipliers = file.array(name, len(known.statement.loop.states), 2)
    require(bool(np.all(multipliers >= 0.0)), "witness: multipliers")
    return multipliers


@dataclass(frozen=True, eq=False)
class RegionWitness(Stated):
    """Data for the proof of a region on boxes, not part of the claim.

    The bounds of the deviations z are proved with multiples of rho - V.

    multipliers: (n, 2), nonnegative factors of rho - V for the lower and upper bound of each z_i
    boxes: number of boxes after which the checker stops
    """

    multipliers: np.ndarray = entry(_read_multipliers)
    boxes: int = entry(lambda file, name, known: file.count(name, _MOST_BOXES))
