"""The statement about a lower bound of the cost. The checker interprets or refuses every field, the
digest covers all of them, and a report shows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.piece import Piece
from hfa_boxes.check.plant import Plant
from hfa_boxes.check.statement import facts, numbers_of, pair_of, read_plant
from hfa_proof.checker.reading import Fields, require


@dataclass(frozen=True, eq=False)
class CostStatement:
    """No flight within the limits that ends at the equilibrium costs less than the largest bound of
    the pieces; cost: ∫ z'Qz + v'Rv dt, z and v: deviations of states and inputs from it.

    plant: the model; its limits of states are the envelope
    equilibrium: moving state or input -> value, within 1e-6 nominal values
    Q: (n, n), symmetric, positive semidefinite
    R: (m, m), symmetric, positive semidefinite
    pieces: each proved separately
    """

    plant: Plant
    equilibrium: Mapping[str, float]
    Q: np.ndarray
    R: np.ndarray
    pieces: tuple[Piece, ...]

    @classmethod
    def read(cls, content: Any, own: Model | None) -> CostStatement:
        """The statement of a certificate.

        content: of its entry `statement`
        own: the user's model, if the statement concerns one

        Malformed names the first entry that cannot be; BadInputError another model.
        """
        entries = Fields("statement", content)
        plant = read_plant(entries, content, own)
        _check_limits(plant)
        n, m = len(plant.states), len(plant.inputs)
        equilibrium = numbers_of(entries, "equilibrium", (*plant.states, *plant.inputs))
        Q = entries.symmetric("Q", n)
        R = entries.symmetric("R", m)
        require(is_semidefinite(Q), "statement: Q: not positive semidefinite")
        require(is_semidefinite(R), "statement: R: not positive semidefinite")
        pieces = tuple(Piece.read(fields, n) for fields in entries.items("pieces"))
        require(bool(pieces), "statement: pieces")
        entries.close()
        return cls(plant, equilibrium, Q, R, pieces)

    def content(self) -> dict[str, Any]:
        """Return the statement as stored in a file, which `read` reads."""
        plant = self.plant
        return {
            **facts(plant.model),
            "parameters": dict(plant.parameters),
            "trim": dict(plant.trim),
            "inputs": dict(plant.inputs),
            "held": dict(plant.held),
            "limits": {name: pair_of(pair) for name, pair in plant.limits.items()},
            "equilibrium": dict(self.equilibrium),
            "Q": self.Q.tolist(),
            "R": self.R.tolist(),
            "pieces": [piece.content() for piece in self.pieces],
        }

    def bound(self, z: np.ndarray) -> np.ndarray:
        """(N,), the least cost from the deviations z (N, n) from the trim is at least this; in
        doubles."""
        plant = self.plant
        offset = np.array([self.equilibrium[name] - plant.trim[name] for name in plant.states])
        return np.asarray(np.max([piece.bound(z - offset) for piece in self.pieces], axis=0))


def is_semidefinite(S: np.ndarray) -> bool:
    """Return whether a symmetric matrix of doubles is positive semidefinite, by exact
    elimination."""
    rows = [[Fraction(value) for value in row] for row in S.tolist()]
    n = len(rows)
    for k in range(n):
        pivot = rows[k][k]
        if pivot < 0 or (pivot == 0 and any(rows[k][k:])):
            return False
        if pivot == 0:
            continue
        for i in range(k + 1, n):
            factor = rows[i][k] / pivot
            for j in range(k + 1, n):
                rows[i][j] -= factor * rows[k][j]
    return True


def _check_limits(plant: Plant) -> None:
    """Malformed where a limit of an input is not the model's, an output is limited, or a state that
    is held is beyond its limits."""
    for name, signal in plant.model.inputs.items():
        stated = plant.limits.get(name, (-np.inf, np.inf))
        require(stated == (signal.min, signal.max), f"limits: {name} not the model's", stated)
    for name in plant.model.outputs:
        require(name not in plant.limits, f"limits: {name} is an output")
    for name, value in plant.held.items():
        low, high = plant.limits.get(name, (-np.inf, np.inf))
        require(low <= value <= high, f"limits: {name}", value)
