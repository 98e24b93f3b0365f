"""Types of the files of `hfa report` and of the studies shown by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from hfa_support.reporting.results import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class MainJobData(Result):
    """Numbers of the page of `hfa report`.

    ok: whether every check passes.
    regeneration: content of the file of hfa regenerate.
    sweep: content of the file of hfa sweep.
    critics: content of the file of hfa verify, at each requested angle.
    angles: for each requested angle: dihedral_deg; reason, empty if everything was computed; trim,
      model, solution and critic as in the files of hfa trim, linearize, solve and verify.
    claims: claims of studies.section5, read from --claims.
    flights: flights of studies.best_flights, read from --flights.
    """

    schema = "hfa.report/1"

    ok: bool
    regeneration: Mapping[str, Any]
    sweep: Mapping[str, Any]
    critics: Sequence[Mapping[str, Any]]
    angles: Sequence[Mapping[str, Any]]
    claims: Mapping[str, Any] | None
    flights: Mapping[str, Any] | None


@dataclass(frozen=True, kw_only=True, eq=False)
class ClaimsData(Result):
    """Claims of Section 5 of the paper (claims.json of `python -m studies.section5`).

    setting: matrices and configuration.
    laws: laws that were simulated.
    verdicts: number of claims with each verdict: confirmed, not confirmed, not decidable from the
      paper.
    lost_flights: flights that left the envelope: section, name, law, lost_at (s).
    own_failures: flights of this project's laws that failed.
    claims: for each claim: number, says, measured, relation, limit, subject, verdict, reason,
      findings.
    experiments: flights and pictures of each section.
    """

    schema = "hfa.claims/1"

    setting: Mapping[str, Any]
    laws: Mapping[str, str]
    verdicts: Mapping[str, float]
    lost_flights: Sequence[Mapping[str, Any]]
    own_failures: Sequence[str]
    claims: Sequence[Mapping[str, Any]]
    experiments: Sequence[Mapping[str, Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightsData(Result):
    """Flights of the nonlinear HFA from the paper's x(0) (best_flights.json).

    start: state -> its initial deviation from the trim.
    limits: name of a set of limits -> state or input -> lowest and highest value.
    models: dihedral_deg, A and B of each linear model.
    flights: for each angle and set of limits: dihedral_deg; within, the set of limits; best,
      exact_policy, exact_lqr, learned_critic and predictive with costs of flights on the nonlinear
      aircraft.
    """

    schema = "hfa.paper-flights/2"

    start: Mapping[str, float]
    limits: Mapping[str, Mapping[str, Sequence[float]]]
    models: Sequence[Mapping[str, Any]]
    flights: Sequence[Mapping[str, Any]]
