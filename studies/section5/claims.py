"""What Section 5 says, and how it is checked against what was simulated."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import Check, checked
from studies.section5.configuration import Criteria
from studies.section5.experiment_flights import FlightPlan, FlightRecord
from studies.section5.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, MODIFIED, PRINTED
from studies.section5.setting import Setting

CONFIRMED, NOT_CONFIRMED = "confirmed", "not confirmed"
NOT_DECIDABLE = "not decidable from the paper"
#: Whose numbers stand beside the paper's law, and the optimum that tells what any law could do.
LEARNING = (PRINTED, MODIFIED, CERTIFIED)
TRACKING = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF)
OPTIMUM = EXACT_FF


class FlightLostError(Exception):
    """A number was asked of a flight that did not come to its end."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The flights of one experiment by plan."""

    setting: Setting
    section: str
    flown: Mapping[FlightPlan, FlightRecord]

    def record(self, plan: FlightPlan) -> FlightRecord:
        """A flight that came to its end; raises FlightLostError for one that did not."""
        found = self.flown[plan]
        if not found.held:
            raise FlightLostError(f"{found.plan.name}: lost at {found.lost_at:.4g} s")
        return found

    def records(self, *plans: FlightPlan) -> list[FlightRecord]:
        """Several such flights."""
        return [self.record(plan) for plan in plans]


@dataclass(frozen=True)
class Claim:
    """One checkable sentence: `measure(evidence, law) relation limit`.

    says: the paper's sentence, paraphrased. what: the number that is measured, with its unit. limit: a number, or the
    name of one of the `Criteria`. laws: for which it is measured; subject: the one it is about. missing: what the
    paper would have to say before the sentence could be decided; "" when it can. why: what lies behind the outcome, as
    far as the number does not tell.
    """

    number: str
    says: str
    what: str
    measure: Callable[[Evidence, str], float]
    relation: str
    limit: float | str
    laws: tuple[str, ...] = TRACKING
    subject: str = MODIFIED
    missing: str = ""
    why: str = ""

    def limit_of(self, criteria: Criteria) -> float:
        """The limit as a number."""
        return float(getattr(criteria, self.limit)) if isinstance(self.limit, str) else self.limit


@dataclass(frozen=True)
class CheckedClaim:
    """A claim with one check for each law, its verdict and the reason.

    checks: by law; value inf and the reason which flight it was when a flight was lost.
    """

    claim: Claim
    limit: float
    verdict: str
    reason: str
    checks: Mapping[str, Check]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; a number that is not finite becomes None."""
        return {
            "number": self.claim.number,
            "says": self.claim.says,
            "measured": self.claim.what,
            "relation": self.claim.relation,
            "limit": self.limit,
            "subject": self.claim.subject,
            "verdict": self.verdict,
            "reason": self.reason,
            "findings": {
                law: {"value": finite_or_none(check.value), "holds": check.ok, "note": check.reason}
                for law, check in self.checks.items()
            },
        }


def check_claim(claim: Claim, evidence: Evidence) -> CheckedClaim:
    """Measure a claim for every law; a law whose flight was lost does not fulfil it, whatever the number would be."""
    limit = claim.limit_of(evidence.setting.configuration.criteria)
    checks = {law: _check(claim, evidence, law, limit) for law in claim.laws}
    verdict = CONFIRMED if checks[claim.subject].ok else NOT_CONFIRMED
    return CheckedClaim(
        claim, limit, NOT_DECIDABLE if claim.missing else verdict, _reason(claim, checks, limit), checks
    )


def _check(claim: Claim, evidence: Evidence, law: str, limit: float) -> Check:
    try:
        value = claim.measure(evidence, law)
    except FlightLostError as lost:
        return Check(law, math.inf, limit, ok=False, reason=str(lost), relation=claim.relation)
    return checked(law, value, claim.relation, limit)


def _reason(claim: Claim, checks: Mapping[str, Check], limit: float) -> str:
    """The subject's number against the limit, what the optimum does, and what lies behind it."""
    own = checks[claim.subject]
    parts = [f"the paper would have to give {claim.missing}"] if claim.missing else []
    told = own.reason or f"{claim.what}: {own.value:.3g}"
    parts.append(f"{claim.subject}: {told}; the limit is {claim.relation} {limit:.3g}")
    if claim.subject == MODIFIED and OPTIMUM in checks and not own.ok:
        best = checks[OPTIMUM]
        able = "the optimum meets it" if best.ok else "not even the optimum of this game meets it"
        parts.append(f"{able} ({best.value:.3g})")
    return "; ".join([*parts, *([claim.why] if claim.why else [])])
