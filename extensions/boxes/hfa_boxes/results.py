"""Results about regions that are proved on boxes, as written in JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_boxes.check.loop import Loop
from hfa_boxes.check.piece import Piece
from hfa_boxes.check.statement import BoxStatement, Gain
from hfa_proof.results import ProvedResult
from hfa_support.reporting.results import Matrix, Vector


@dataclass(frozen=True, eq=False)
class BoxSet(ProvedResult):
    """Region of attraction proved on boxes.

    statement: the proved statement.
    boxes: number of boxes that the proof evaluated.
    """

    json_keys = (
        "proved prover rho states state_units trim parameters equilibrium policy limits extents "
        "degree P? M coefficients powers boxes"
    )

    statement: BoxStatement
    boxes: int

    @property
    def subject(self) -> Loop:
        """The closed loop of the statement: model, trim, limits and policy."""
        return self.statement.loop

    @property
    def prover(self) -> str:
        """Method of the proof: `boxes`, branch and bound."""
        return "boxes"

    @property
    def rho(self) -> float:
        """Level of V. The set is {V <= rho}."""
        return self.statement.rho

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State -> approximate value at the proved equilibrium of the loop."""
        return self.statement.equilibrium

    @property
    def policy(self) -> str | Mapping[str, Any]:
        """SHA-256 of the policy's instructions, or the coefficients of a polynomial policy.

        The coefficients are K and the terms of q in u0 - K (x - x0) + q(x - x0), with the trim x0,
        u0.
        """
        stated = self.statement.policy
        return stated.content() if isinstance(stated, Gain) else stated

    @property
    def extents(self) -> Mapping[str, float]:
        """State -> upper bound of the absolute deviation from the equilibrium in the set."""
        return {name: max(-low, high) for name, (low, high) in self.statement.extents.items()}

    @property
    def degree(self) -> int:
        """Degree of V."""
        return self.statement.degree

    @property
    def P(self) -> Matrix | None:
        """Matrix P (n, n) of V = z'P z, rounded to doubles, or None if V has a degree above 2."""
        return quadratic_form(self.statement.piece)

    @property
    def M(self) -> Matrix:
        """Matrix M (n, n) of the coordinates y = M z of V. The set is within |y_i| < 1."""
        return self.statement.piece.M

    @property
    def coefficients(self) -> Vector:
        """Coefficients of the monomials of V in y."""
        return np.array([value for value, _ in self.statement.piece.W.terms])

    @property
    def powers(self) -> Sequence[Sequence[int]]:
        """Powers of each monomial of V, (terms, n)."""
        return [powers for _, powers in self.statement.piece.W.terms]


def quadratic_form(piece: Piece) -> Matrix | None:
    """Return P (n, n) with W(M z) = z'P z, rounded to doubles.

    Return None if W has a degree above 2.
    """
    M = piece.M
    S = np.zeros((len(M), len(M)))
    for value, powers in piece.W.terms:
        if sum(powers) > 2:
            return None
        i, j = np.repeat(np.arange(len(M)), powers)
        S[i, j] += value / 2
        S[j, i] += value / 2
    return np.asarray(M.T @ S @ M)


@dataclass(frozen=True, eq=False)
class FoundBoxes(BoxSet):
    """Region of attraction that a search has found and proved.

    origin: description of how V was found.
    decrease_fails_at: state -> deviation at the first obstacle to a larger level if V' >= 0 there,
        otherwise None.
    stopped: reason why no larger level is proved.
    """

    schema = "hfa.region-boxes/1"
    made_by = "hfa prove region --prover boxes"
    json_keys = f"{BoxSet.json_keys} origin decrease_fails_at stopped"

    origin: str
    decrease_fails_at: Mapping[str, float] | None
    stopped: str


@dataclass(frozen=True, eq=False)
class CheckedBoxes(BoxSet):
    """Region of attraction that a certificate proves.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.region-boxes-check/1"
    made_by = "hfa prove region --check FILE"
    json_keys = f"{BoxSet.json_keys} written not_given"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()
