"""Results about proved sets, as written by `hfa prove region --json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hfa_proof.results import ProvedResult
from hfa_region.check.statement import RegionStatement, SaturatedLoop
from hfa_support.reporting.results import Matrix, Result


class Place(NamedTuple):
    """A level of V, and a state deviation from the equilibrium at that level."""

    V: float
    z: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class ProvedSet(ProvedResult):
    """Set proved by sums of squares, a region of attraction or an invariant set.

    statement: the proved statement.
    parts: number of parts of the set, or of its boundary, on which V' < 0 is proved.
    reaches: state -> lowest and highest deviation in the set.
    """

    json_keys = (
        "proved prover rho states state_units trim parameters K policy limits disturbances extents "
        "terms P? parts"
    )

    statement: RegionStatement
    parts: int
    reaches: Mapping[str, tuple[float, float]]

    @property
    def subject(self) -> SaturatedLoop:
        """The closed loop: model, trim, limits and policy."""
        return self.statement.loop

    @property
    def prover(self) -> str:
        """Method of the proof: `squares`, sums of squares."""
        return "squares"

    @property
    def rho(self) -> float:
        """Level of V. The set is {V(z) <= rho}, with z the deviation from the equilibrium."""
        return self.statement.rho

    @property
    def K(self) -> Matrix:
        """Gain K (m, n) of u = sat(u0 - K (x - x0) + q(x - x0)), with the trim x0, u0."""
        return self.statement.loop.K

    @property
    def policy(self) -> Mapping[str, Sequence[Any]]:
        """Input -> q as a list of [coefficient, exponents], omitted if q = 0.

        q is the nonlinear part of u = sat(u0 - K (x - x0) + q(x - x0)), with the trim x0, u0.
        """
        return self.statement.loop.policy

    @property
    def disturbances(self) -> Mapping[str, float]:
        """Disturbance -> its largest absolute value."""
        return self.statement.loop.disturbances

    @property
    def extents(self) -> Mapping[str, float]:
        """State -> upper bound of the absolute deviation in the set.

        The set is smaller than the box of these bounds.
        """
        return {name: max(-low, high) for name, (low, high) in self.reaches.items()}

    @property
    def terms(self) -> Sequence[Any]:
        """Terms of V = Σ coefficient z^exponents, as a list of [coefficient, exponents]."""
        return self.statement.terms

    @property
    def degree(self) -> int:
        """Degree of V."""
        return max(sum(exponents) for _, exponents in self.terms)

    @property
    def P(self) -> Matrix | None:
        """Matrix P (n, n) of V = z'P z, or None if V has a degree above 2."""
        if self.degree > 2:
            return None
        n = len(self.states)
        P = np.zeros((n, n))
        for coefficient, exponents in self.terms:
            i, j = np.repeat(np.arange(n), exponents)
            P[i, j] += coefficient / 2
            P[j, i] += coefficient / 2
        return P


@dataclass(frozen=True, eq=False)
class FoundSet(ProvedSet):
    """Set that a search has found and proved by sums of squares.

    origin: description of how V was found.
    decrease_fails_at: lowest level of V at which V' >= 0 was found, with the state, or None.
    leaves_limits_at: lowest level of V at an initial condition whose trajectory exceeds a limit,
        with the state, or None.
    lost_at: lowest level of V at an initial condition whose trajectory diverges or converges to
        another equilibrium, with the state, or None.
    limits_that_bind: signals whose limits the set nearly reaches.
    stopped: "interrupted" after Ctrl-C, otherwise "".
    """

    schema = "hfa.region/1"
    made_by = "hfa prove region"
    json_keys = (
        f"{ProvedSet.json_keys} origin decrease_fails_at leaves_limits_at lost_at limits_that_bind "
        "stopped"
    )

    origin: str
    decrease_fails_at: Place | None
    leaves_limits_at: Place | None
    lost_at: Place | None
    limits_that_bind: Sequence[str]
    stopped: str = ""


@dataclass(frozen=True)
class NothingProved(Result):
    """Result of a search in which no set is proved.

    proved: False.
    """

    proved: bool = False


@dataclass(frozen=True, eq=False)
class WithRegion(Result):
    """Entries that `--region S` adds to a result.

    region: region of attraction of the saturated loop, or None without the option.
    """

    region: FoundSet | NothingProved | None = None


@dataclass(frozen=True, eq=False)
class CheckedSet(ProvedSet):
    """Set that a certificate proves by sums of squares.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.region-check/1"
    made_by = "hfa prove region --check FILE"
    json_keys = f"{ProvedSet.json_keys} written not_given"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()
