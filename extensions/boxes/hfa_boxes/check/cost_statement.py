"""The statement about a lower bound of the cost. The checker interprets or refuses every field, the
digest covers all of them, and a report shows them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_boxes.check.cost import Polynomial, is_exact
from hfa_boxes.check.plant import Plant
from hfa_boxes.check.statement import facts, numbers_of, pair_of, read_plant
from hfa_proof.checker.reading import Fields, require

#: Higher degrees are refused.
HIGHEST = 12
_MOST_TERMS = 5000


class Piece(NamedTuple):
    """No flight costs less than the lesser of W(y) and c where it begins in the cube |y_i| < 1,
    y = M z, and none less than c where it begins elsewhere.

    M: (n, n)
    W: polynomial of y without terms of degree 0 and 1
    c: level
    """

    M: np.ndarray
    W: Polynomial
    c: float

    def bound(self, z: np.ndarray) -> np.ndarray:
        """(N,), at deviations z (N, n) from the equilibrium, in doubles."""
        y = z @ self.M.T
        inside = np.all(np.abs(y) < 1.0, axis=1)
        return np.where(inside, np.minimum(self.W.at(y), self.c), self.c)


@dataclass(frozen=True, eq=False)
class CostStatement:
    """No flight within the limits that ends at the equilibrium costs less than the largest bound of
    the pieces; cost: ∫ z'Qz + v'Rv dt, z and v: deviations of states and inputs from it.

    plant: the model; its limits of states are the envelope
    equilibrium: moving state or input -> value, within 1e-6 nominal values
    Q: (n, n), symmetric, positive semidefinite
    R: (m, m), symmetric, positive semidefinite
    pieces: each proved by itself
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
        own: the user's model, where it is about one

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
        pieces = tuple(_piece(fields, n) for fields in entries.items("pieces"))
        require(bool(pieces), "statement: pieces")
        entries.close()
        return cls(plant, equilibrium, Q, R, pieces)

    def content(self) -> dict[str, Any]:
        """The statement as a file has it; `read` reads it back."""
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
            "pieces": [
                {
                    "M": piece.M.tolist(),
                    "W": [[value, list(powers)] for value, powers in piece.W.terms],
                    "c": piece.c,
                }
                for piece in self.pieces
            ],
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


def _piece(entries: Fields, n: int) -> Piece:
    piece = Piece(entries.array("M", n, n), _polynomial(entries, n), entries.number("c", above=0.0))
    entries.close()
    return piece


def _polynomial(entries: Fields, n: int) -> Polynomial:
    """Read the terms of a polynomial, each of degree 2 or more and listed once."""
    listed = entries.value("W", lambda value: isinstance(value, list))
    require(0 < len(listed) <= _MOST_TERMS, "W", len(listed))
    terms = []
    for number, entry in enumerate(listed):
        where = f"{entries.where}: W {number}"
        require(isinstance(entry, list) and len(entry) == 2, where, entry)
        value = Fields(where, {"coefficient": entry[0]}).number("coefficient")
        powers = entry[1]
        require(isinstance(powers, list) and len(powers) == n, where, powers)
        require(all(type(power) is int and power >= 0 for power in powers), where, powers)
        require(2 <= sum(powers) <= HIGHEST, where, powers)
        require(is_exact(value, powers), where, value)
        terms.append((value, tuple(powers)))
    require(len({powers for _, powers in terms}) == len(terms), f"{entries.where}: W")
    return Polynomial(n, tuple(terms))


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
