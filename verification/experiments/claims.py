"""What Section 5 says, and the machinery that holds it against what was flown."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from hfa_model.support.checks import finite_or_none
from verification.experiments.experiment_flights import FlightPlan, FlightRecord
from verification.experiments.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, HELPED, PRINTED
from verification.experiments.setting import Setting

CONFIRMED, NOT_CONFIRMED = "confirmed", "not confirmed"
NOT_JUDGED = "cannot be judged from the print"
#: Whose findings stand beside the paper's law, and the optimum that tells what any law could do.
LEARNING = (PRINTED, HELPED, CERTIFIED)
TRACKING = (PRINTED, HELPED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF)
OPTIMUM = EXACT_FF
#: The subject of statements about the printed numbers themselves.
PRINT = "the print"
_RELATIONS: Mapping[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


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
    name of one in the criteria of the reading. laws: for which it is measured; subject: the one it is about. missing:
    what the print would have to say before the sentence could be judged; "" when it can. why: what lies behind the
    outcome, as far as the number does not tell.
    """

    number: str
    says: str
    what: str
    measure: Callable[[Evidence, str], float]
    relation: str
    limit: float | str
    laws: tuple[str, ...] = TRACKING
    subject: str = HELPED
    missing: str = ""
    why: str = ""


@dataclass(frozen=True)
class Finding:
    """value: inf when a flight was lost, and then `holds` is False and `note` says which."""

    value: float
    holds: bool
    note: str = ""


@dataclass(frozen=True)
class Judgement:
    """A claim with its findings by law, its verdict and the reason."""

    claim: Claim
    limit: float
    verdict: str
    reason: str
    findings: Mapping[str, Finding] = field(default_factory=dict)

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
                law: {"value": finite_or_none(found.value), "holds": found.holds, "note": found.note}
                for law, found in self.findings.items()
            },
        }


def judge(claim: Claim, evidence: Evidence) -> Judgement:
    """Measure a claim for every law; a law whose flight was lost does not fulfil it, whatever the number would be."""
    limit = evidence.setting.reading["criteria"][claim.limit] if isinstance(claim.limit, str) else claim.limit
    findings = {law: _find(claim, evidence, law, limit) for law in claim.laws}
    holds = findings[claim.subject].holds
    verdict = NOT_JUDGED if claim.missing else CONFIRMED if holds else NOT_CONFIRMED
    return Judgement(claim, limit, verdict, _reason(claim, findings, limit), findings)


def _find(claim: Claim, evidence: Evidence, law: str, limit: float) -> Finding:
    try:
        value = claim.measure(evidence, law)
    except FlightLostError as lost:
        return Finding(math.inf, False, str(lost))
    return Finding(value, not math.isnan(value) and _RELATIONS[claim.relation](value, limit))


def _reason(claim: Claim, findings: Mapping[str, Finding], limit: float) -> str:
    """The subject's number against the limit, what the optimum does, and what lies behind it."""
    own = findings[claim.subject]
    parts = [f"the print would have to give {claim.missing}"] if claim.missing else []
    told = own.note or f"{claim.what}: {own.value:.3g}"
    parts.append(f"{claim.subject}: {told}; asked for is {claim.relation} {limit:.3g}")
    if claim.subject == HELPED and OPTIMUM in findings and not own.holds:
        best = findings[OPTIMUM]
        able = "the optimum does it" if best.holds else "not even the optimum of this game does it"
        parts.append(f"{able} ({best.value:.3g})")
    return "; ".join([*parts, *([claim.why] if claim.why else [])])
