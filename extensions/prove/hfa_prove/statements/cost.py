"""Statement of a certificate about a lower bound of the cost.

The checker interprets or refuses every field. The digest covers all fields, and reports show them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_prove.enclosure.balls import lowest_sign
from hfa_prove.fields import Fields, Statement, Witness, entry, part, require
from hfa_prove.statements.piece import Piece
from hfa_prove.statements.plant import Plant

#: Largest number of boxes that a certificate may state.
_MOST_BOXES = 1_000_000_000


@dataclass(frozen=True, eq=False)
class CostStatement(Statement):
    """Claim that the cost of a flight is at least the largest lower bound that a piece gives.

    The claim covers every flight within the limits that ends at the equilibrium. The cost is
    ∫ z'Qz + v'Rv dt, with z and v the deviations of states and inputs from the equilibrium.

    plant: the model, whose state limits are the envelope
    equilibrium: moving state or input -> value, within `SAME_TRIM` nominal values of the proved
        equilibrium
    Q: (n, n), symmetric, positive semidefinite
    R: (m, m), symmetric, positive semidefinite
    pieces: polynomials W with levels, each proved separately
    """

    plant: Plant = part(Plant)
    equilibrium: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, (*known.plant.states, *known.plant.inputs))
    )
    Q: np.ndarray = entry(
        lambda file, name, known: file.symmetric(name, len(known.plant.states)), subject="weights"
    )
    R: np.ndarray = entry(
        lambda file, name, known: file.symmetric(name, len(known.plant.inputs)), subject="weights"
    )
    pieces: tuple[Piece, ...] = entry(
        lambda file, name, known: tuple(
            Piece.read(each, len(known.plant.states)) for each in file.items(name)
        ),
        store=lambda pieces: [piece.content() for piece in pieces],
    )

    def check_consistent(self) -> None:
        """Raise Malformed if weights, pieces or limits are not admissible.

        Input limits must be the model's, and no output has a limit.
        """
        require(lowest_sign(self.Q) >= 0, "statement: Q: not positive semidefinite")
        require(lowest_sign(self.R) >= 0, "statement: R: not positive semidefinite")
        require(bool(self.pieces), "statement: pieces")
        limits = self.plant.limits
        for name, signal in self.plant.model.inputs.items():
            stated = limits.get(name, (-np.inf, np.inf))
            require(stated == (signal.min, signal.max), f"limits: {name} not the model's", stated)
        for name in self.plant.model.outputs:
            require(name not in limits, f"limits: {name} is an output")

    @property
    def level(self) -> float:
        """Largest level c of the pieces, which is the largest value of `bound`."""
        return max(piece.c for piece in self.pieces)

    def bound(self, z: np.ndarray) -> np.ndarray:
        """Return the lower bounds (N,) of the cost from deviations z (N, n) from the trim.

        The bounds are computed in double precision without outward rounding.
        """
        plant = self.plant
        offset = np.array([self.equilibrium[name] - plant.trim[name] for name in plant.states])
        return np.asarray(np.max([piece.bound(z - offset) for piece in self.pieces], axis=0))


@dataclass(frozen=True, eq=False)
class CostWitness(Witness):
    """Data for the proof of a lower bound of the cost, not part of the claim.

    solved: names of the states and inputs that are the unknowns of the equilibrium
    boxes: number of boxes for each piece after which the checker stops
    """

    solved: tuple[str, ...]
    boxes: tuple[int, ...]

    @classmethod
    def read(cls, entries: Fields, statement: CostStatement) -> CostWitness:
        """Return the witness of a certificate.

        Raises Malformed for the first wrong entry.
        """
        plant = statement.plant
        solved = entries.texts("solved", (*plant.states, *plant.inputs))
        require(len(set(solved)) == len(solved), "witness: solved", list(solved))
        counts = entries.array("boxes", len(statement.pieces))
        require(bool(np.all(counts <= _MOST_BOXES)), "witness: boxes", counts.tolist())
        entries.close()
        return cls(solved, tuple(int(count) for count in counts))

    def content(self) -> dict[str, Any]:
        """Return the certificate's entry `witness`, in the form that `read` accepts."""
        return {"solved": list(self.solved), "boxes": list(self.boxes)}
