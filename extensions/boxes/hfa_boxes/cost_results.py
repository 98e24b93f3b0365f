"""Data of lower bounds of the cost that are proved on boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hfa_boxes.check.cost_statement import CostStatement
from hfa_boxes.check.plant import Plant
from hfa_proof.results import ProvedResult
from hfa_support.reporting.results import Matrix, Result, Vector


@dataclass(frozen=True, eq=False)
class BoundPiece(Result):
    """Lower bound of the cost by one polynomial W of the deviations z from the equilibrium.

    A flight that begins with |(M z)_i| < 1 costs at least the smaller of W(M z) and c. A flight
    that begins elsewhere costs at least c.

    c: level.
    M: (n, n).
    coefficients: coefficients of the monomials of W.
    powers: (terms, n), powers of each monomial.
    boxes: number of boxes of the proof.
    """

    c: float
    M: Matrix
    coefficients: Vector
    powers: Sequence[Sequence[int]]
    boxes: int


@dataclass(frozen=True, eq=False)
class LowerBound(ProvedResult):
    """Proved lower bound of the cost of every flight.

    statement: the proved statement.
    boxes: number of boxes of each piece.
    """

    json_keys = "proved states state_units trim parameters equilibrium limits Q R pieces"

    statement: CostStatement
    boxes: Sequence[int]

    @property
    def subject(self) -> Plant:
        """The aircraft."""
        return self.statement.plant

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State or input -> value near which the equilibrium is enclosed."""
        return self.statement.equilibrium

    @property
    def Q(self) -> Matrix:
        """Weight of the states, (n, n)."""
        return self.statement.Q

    @property
    def R(self) -> Matrix:
        """Weight of the inputs, (m, m)."""
        return self.statement.R

    @property
    def pieces(self) -> Sequence[BoundPiece]:
        """Bounds by single polynomials; the largest of them holds."""
        found = []
        for piece, boxes in zip(self.statement.pieces, self.boxes, strict=True):
            values = np.array([value for value, _ in piece.W.terms])
            powers = [powers for _, powers in piece.W.terms]
            found.append(BoundPiece(piece.c, piece.M, values, powers, boxes))
        return found


@dataclass(frozen=True, eq=False)
class FoundLowerBound(LowerBound):
    """A bound that a search has found and proved.

    stopped: why no larger level is proved, or "" if all initial conditions are below the last
        level.
    """

    schema = "hfa.lower-bound/1"
    made_by = "hfa prove cost"
    json_keys = f"{LowerBound.json_keys} stopped"

    stopped: str


@dataclass(frozen=True, eq=False)
class CheckedLowerBound(LowerBound):
    """Bound proved by a certificate.

    written: version, command and date in the file, not verified.
    not_given: parts of the subject that no option gave, so that they were not compared.
    """

    schema = "hfa.lower-bound-check/1"
    made_by = "hfa prove cost --check FILE"
    json_keys = f"{LowerBound.json_keys} written not_given"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()
