"""A region that is proved on boxes, as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hfa_boxes.check.statement import BoxStatement
from hfa_support.reporting.results import Matrix, Result


@dataclass(frozen=True, eq=False)
class BoxSet(Result):
    """A proved set.

    statement: the proved statement.
    boxes: number of boxes on which V' < 0.
    """

    keys = "proved prover rho states state_units trim equilibrium policy limits extents P boxes"

    statement: BoxStatement
    boxes: int

    @property
    def proved(self) -> bool:
        """True: a set that is not proved is not printed."""
        return True

    @property
    def prover(self) -> str:
        """boxes: branch and bound."""
        return "boxes"

    @property
    def rho(self) -> float:
        """Level of V: the set is z'P z <= rho, z the deviations from the equilibrium."""
        return self.statement.rho

    @property
    def states(self) -> Sequence[str]:
        """Names of the entries of z."""
        return self.statement.loop.states

    @property
    def state_units(self) -> Sequence[str]:
        """Unit of each state."""
        return self.statement.loop.model.units(self.states)

    @property
    def trim(self) -> Mapping[str, float]:
        """State or input -> value at the trim, which the policy is about."""
        loop = self.statement.loop
        return {**loop.trim, **loop.inputs, **loop.held}

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State -> value at the equilibrium of the loop."""
        return self.statement.equilibrium

    @property
    def policy(self) -> str:
        """SHA-256 of the policy."""
        return self.statement.digest

    @property
    def limits(self) -> Mapping[str, Sequence[float]]:
        """Signal -> lowest and highest value."""
        return self.statement.loop.limits

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
