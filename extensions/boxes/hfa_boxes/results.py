"""A region that is proved on boxes, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from hfa_boxes.check.loop import Loop
from hfa_boxes.check.statement import BoxStatement
from hfa_proof.results import ProvedResult
from hfa_support.reporting.results import Matrix


@dataclass(frozen=True, eq=False)
class BoxSet(ProvedResult):
    """A set that is proved.

    statement: the proved statement.
    boxes: number of boxes on which V' < 0.
    """

    keys = "proved prover rho states state_units trim equilibrium policy limits extents P boxes"

    statement: BoxStatement
    boxes: int

    @property
    def subject(self) -> Loop:
        """The model with its policy."""
        return self.statement.loop

    @property
    def prover(self) -> str:
        """boxes: branch and bound."""
        return "boxes"

    @property
    def rho(self) -> float:
        """Level of V: the set is z'P z <= rho, z the deviations from the equilibrium."""
        return self.statement.rho

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State -> value at the equilibrium of the loop."""
        return self.statement.equilibrium

    @property
    def policy(self) -> str:
        """SHA-256 of the policy."""
        return self.statement.digest

    @property
    def extents(self) -> Mapping[str, float]:
        """State -> how far the set reaches from the equilibrium, or less."""
        return self.statement.extents

    @property
    def P(self) -> Matrix:
        """(n, n), of V = z'P z."""
        return self.statement.P


@dataclass(frozen=True, eq=False)
class FoundBoxes(BoxSet):
    """A set that a search has found and proved.

    origin: what V is.
    decrease_fails_at: the lowest level at which V' >= 0 was found, and the state there as
        deviation; None where none was.
    stopped: why no larger level is proved.
    """

    schema = "hfa.region-boxes/1"
    made_by = "hfa prove region --weights NETWORK"
    keys = f"{BoxSet.keys} origin decrease_fails_at stopped"

    origin: str
    decrease_fails_at: Mapping[str, float] | None
    stopped: str


@dataclass(frozen=True, eq=False)
class CheckedBoxes(BoxSet):
    """A set that a certificate proves.

    written: version, command and date in the file, which nothing verifies.
    """

    schema = "hfa.region-boxes-check/1"
    made_by = "hfa prove region --check FILE"
    keys = f"{BoxSet.keys} written"

    written: Mapping[str, str]
