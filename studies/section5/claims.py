"""The claims of Section 5 (claims.toml), the number measured for each claim, and its verdict."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from hfa.extend import Check
from hfa_model import LINEAR_STATES, published_models
from hfa_model.published import published_data
from hfa_support.files import read_toml
from hfa_support.reporting.checks import checked
from hfa_support.reporting.data_files import finite_or_none
from studies.section5.configuration import Configuration
from studies.section5.flights import (
    CASE_I,
    CASE_II,
    CERTIFIED,
    CERTIFIED_FF,
    EXACT,
    EXACT_FF,
    INTEGRAL,
    MODIFIED,
    PRINTED,
    REWEIGHTED,
    FlightPlan,
    FlightRecord,
    Setting,
)
from studies.section5.metrics import over

CONFIRMED = "confirmed"
NOT_CONFIRMED = "not confirmed"
NOT_DECIDABLE = "not decidable from the paper"
VERDICTS = (CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE)
#: Groups of laws in claims: laws whose learning is measured, and laws that track.
LEARNING = (PRINTED, MODIFIED, CERTIFIED)
TRACKING = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF)
_TOGETHER = {"learning": LEARNING, "tracking": TRACKING}
#: The optimal law, with which other laws are compared.
OPTIMUM = EXACT_FF


def flights_of(group: str, configuration: Configuration, law: str) -> tuple[FlightPlan, ...]:
    """Return the plans of a law's flights in a group. Claims refer to groups of flights.

    group: name of the group, for example "both cases" or "noise"
    """
    both = (CASE_I, CASE_II)
    at_5 = FlightPlan(CASE_II, law)
    return {
        "both cases": tuple(FlightPlan(angle, law) for angle in both),
        "5 deg": (at_5,),
        "disturbance alone": tuple(FlightPlan(angle, law, commanded=False) for angle in both),
        INTEGRAL: (FlightPlan(CASE_II, INTEGRAL),),
        "every uncertainty": tuple(
            replace(at_5, uncertainty=factor) for factor in configuration.uncertainty.factors
        ),
        "noise": (replace(at_5, noise=True),),
    }[group]


def plans_of(section: str, setting: Setting) -> tuple[FlightPlan, ...]:
    """Return the plans of all flights of a section."""
    both = (CASE_I, CASE_II)
    factors = setting.configuration.uncertainty.factors
    if section == "5.1":  # and from equilibrium under the disturbance alone
        flown = [FlightPlan(angle, law) for angle in both for law in (*TRACKING, REWEIGHTED)]
        alone = (PRINTED, MODIFIED, CERTIFIED, EXACT)
        return (
            *flown,
            *(FlightPlan(angle, law, commanded=False) for law in alone for angle in both),
        )
    if section == "5.2":
        laws = (PRINTED, MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL, EXACT, EXACT_FF)
        return tuple(FlightPlan(CASE_II, law) for law in laws)
    if section == "5.3":
        return tuple(FlightPlan(CASE_II, law, factor) for law in TRACKING for factor in factors)
    return tuple(
        FlightPlan(CASE_II, law, noise=noise) for law in TRACKING for noise in (True, False)
    )


class LeftEnvelopeError(Exception):
    """Raised if a number is requested of a flight that left the envelope."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The simulated flights of one section.

    flown: plan -> record of the flight
    """

    setting: Setting
    section: str
    flown: Mapping[FlightPlan, FlightRecord]

    def record(self, plan: FlightPlan) -> FlightRecord:
        """Return the record of a flight. Raises FlightLostError if the flight left the envelope."""
        found = self.flown[plan]
        if not found.held:
            raise LeftEnvelopeError(f"{found.plan.name}: lost at {found.lost_at:.4g} s")
        return found

    def numbers(self, group: str, law: str, name: str, of: tuple[str, ...] = ()) -> np.ndarray:
        """Return a metric of each flight of a law in a group, (flights, names).

        group: name of the group, as in `flights_of`
        name: name of the metric
        of: names of states or inputs, or () for all

        Raises FlightLostError if one of the flights left the envelope.
        """
        plans = flights_of(group, self.setting.configuration, law)
        return np.array([_numbers(self.record(plan).metrics, name, of) for plan in plans])


def _numbers(metrics: dict[str, Any], name: str, of: tuple[str, ...]) -> list[float]:
    if name == "attenuation_share":  # below 1, as the game guarantees
        return [metrics["attenuation"] / metrics["delta_squared"]]
    table, _, entry = name.rpartition(".")
    start, before, after = metrics["learning"]["flown_residual"] if table else (0.0, 0.0, 0.0)
    if entry == "residual_growth":
        return [over(after, before)]
    if entry == "residual_drop":
        return [over(after, start)]
    value = metrics[table][entry] if table else metrics[entry]
    return [value[each] for each in of or value] if isinstance(value, Mapping) else [float(value)]


Measure = Callable[[Evidence, str], float]


def measure_of(said: str | Mapping[str, Any]) -> Measure:
    """Return the function (evidence, law) -> number that measures a claim.

    said: a key of `NAMED`, or {HOW: metric, "of": names, "in": group of flights, "to": other group}

    HOW is one of the following:
    - worst, smallest: largest or smallest number
    - spread: largest (largest - smallest) / largest between the flights. The spread is inf if a
      number is inf in some flights only. A number that is inf in all flights is left out. If no
      number remains, the spread is inf.
    - ratio: largest ratio of a number to the same number in the other group
    """
    if isinstance(said, str):
        return NAMED[said]
    ((how, name),) = (
        (key, value)
        for key, value in said.items()
        if key in ("worst", "smallest", "spread", "ratio")
    )
    of = tuple(said.get("of", ()))

    def measure(evidence: Evidence, law: str) -> float:
        found = evidence.numbers(said["in"], law, name, of)
        if how == "ratio":
            others = evidence.numbers(said["to"], law, name, of)
            return max(
                over(*pair)
                for pair in zip(found.ravel().tolist(), others.ravel().tolist(), strict=True)
            )
        if how == "spread":
            return max(
                (_spread(column) for column in found.T if np.isfinite(column).any()), default=np.inf
            )
        return float(found.max() if how == "worst" else found.min())

    return measure


def _spread(values: np.ndarray) -> float:
    if not np.isfinite(values).all():
        return np.inf
    return over(float(np.ptp(values)), float(values.max())) if np.ptp(values) > 0.0 else 0.0


def _gain_error(group: str, *, at_the_end: bool = False) -> Measure:
    """Return a function that measures the largest |K - K*| / |K*| in a group of flights."""

    def of(evidence: Evidence, plan: FlightPlan) -> float:
        record = evidence.record(plan)
        case = evidence.setting.case(plan.dihedral_deg)
        T_w = evidence.setting.configuration.predefined_time(evidence.section)
        row = min(int(np.searchsorted(record.times, T_w - 1e-9)), len(record.times) - 1)
        K = case.game.gain(record.learned_value(-1 if at_the_end else row))
        return float(np.linalg.norm(K - case.exact.K) / np.linalg.norm(case.exact.K))

    def measure(evidence: Evidence, law: str) -> float:
        return max(
            of(evidence, plan) for plan in flights_of(group, evidence.setting.configuration, law)
        )

    return measure


def _final_abscissa(evidence: Evidence, law: str) -> float:
    """Return the spectral abscissa of A - B K at 5 deg for the last learned gain K, 1/s."""
    record = evidence.record(FlightPlan(CASE_II, law))
    game = evidence.setting.case(CASE_II).game
    return float(
        np.linalg.eigvals(game.A - game.B @ game.gain(record.learned_value(-1))).real.max()
    )


def _printed_coupling(evidence: Evidence, law: str) -> float:
    """Return the smaller of two ratios of norms of the pitch-rate row, one for A and one for B."""
    row = LINEAR_STATES.index("pitch_rate")
    sizes = [
        [np.linalg.norm(matrix[row]) for matrix in (model.A, model.B)]
        for model in published_models()
    ]
    return float(min(second / first for first, second in zip(*sizes, strict=True)))


def _eigenvalue_difference(evidence: Evidence, law: str) -> float:
    """Return the largest difference of a quoted eigenvalue from the nearest one of A, 1/s."""
    eigenvalues = np.linalg.eigvals(published_models()[1].A)
    folded = np.abs(eigenvalues.real) + 1j * np.abs(eigenvalues.imag)  # quoted without signs
    quoted = published_data()["eigenvalues_quoted_for_5_deg"][
        "magnitudes"
    ]  # such as "4.82 +/- 18.66i" and "7.11"
    return float(
        max(np.abs(folded - complex(re.sub(" .* (.*)i", r"+\1j", text))).min() for text in quoted)
    )


def _last_gain_error_over_integral(evidence: Evidence, law: str) -> float:
    error = _gain_error("5 deg", at_the_end=True)
    return error(evidence, law) / error(evidence, INTEGRAL)


#: Measures that are not metrics of single flights.
NAMED: dict[str, Measure] = {
    "gain error at T_w": _gain_error("both cases"),
    "last gain error over that of integral RL": _last_gain_error_over_integral,
    "abscissa with the last gain": _final_abscissa,
    "printed pitch-rate coupling": _printed_coupling,
    "commanded dihedral": lambda evidence, _: float(
        np.degrees(evidence.setting.configuration.reference.constant[4])
    ),
    "quoted eigenvalues": _eigenvalue_difference,
}


@dataclass(frozen=True)
class Claim:
    """One claim of the paper that can be checked. claims.toml explains the fields.

    limit: a number, or the name of a criterion of the configuration
    """

    number: str
    says: str
    measured: str
    measure: str | Mapping[str, Any]
    relation: str
    limit: float | str
    laws: tuple[str, ...] = ("tracking",)
    subject: str = MODIFIED
    missing: str = ""
    why: str = ""


def claims_of(section: str) -> tuple[Claim, ...]:
    """Return the claims of a section, in the order of claims.toml."""
    return tuple(
        Claim(**entry) for entry in _entries() if entry["number"].startswith(f"{section}-")
    )


@cache
def _entries() -> tuple[dict[str, Any], ...]:
    table = read_toml(str(Path(__file__).with_name("claims.toml")))
    return tuple(entry for claim in table["claims"] for entry in _each(**claim))


def _each(
    must: str, each: tuple[dict[str, str], ...] = ({},), **claim: Any
) -> Iterator[dict[str, Any]]:
    """Yield one claim for each dictionary in `each`, or a single claim without `each`."""
    relation, limit = must.split()
    asked = {"relation": relation, "limit": limit if limit.isidentifier() else float(limit)}
    for words in each:
        yield _filled(claim, words) | asked | ({"number": words["number"]} if words else {})


def _filled(value: Any, words: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(each, words) for key, each in value.items()}
    if isinstance(value, list):
        return [_filled(each, words) for each in value]
    return value.format(**words) if words else value


def check_claim(claim: Claim, evidence: Evidence) -> dict[str, Any]:
    """Return the measured number and the verdict of a claim for each law, with the reason, for
    JSON.

    A number that is not finite becomes None. A law whose flight left the envelope does not satisfy
    the claim.
    """
    limit = claim.limit
    if isinstance(limit, str):
        limit = float(getattr(evidence.setting.configuration.criteria, limit))
    checks: dict[str, Check] = {}
    for law in (law for name in claim.laws for law in _TOGETHER.get(name, (name,))):
        try:
            checks[law] = checked(
                law, measure_of(claim.measure)(evidence, law), limit, relation=claim.relation
            )
        except LeftEnvelopeError as lost:
            checks[law] = Check(
                law, math.inf, limit, ok=False, reason=str(lost), relation=claim.relation
            )
    verdict = CONFIRMED if checks[claim.subject].ok else NOT_CONFIRMED
    return {
        "number": claim.number,
        "says": claim.says,
        "measured": claim.measured,
        "relation": claim.relation,
        "limit": limit,
        "subject": claim.subject,
        "verdict": NOT_DECIDABLE if claim.missing else verdict,
        "reason": _reason(claim, checks, limit),
        "findings": {
            law: {"value": finite_or_none(check.value), "holds": check.ok, "note": check.reason}
            for law, check in checks.items()
        },
    }


def _reason(claim: Claim, checks: Mapping[str, Check], limit: float) -> str:
    """Return the reason for a verdict: missing data, measured value, limit and cause."""
    own = checks[claim.subject]
    parts = [f"the paper would have to give {claim.missing}"] if claim.missing else []
    told = own.reason or f"{claim.measured}: {own.value:.3g}"
    parts.append(f"{claim.subject}: {told}; the limit is {claim.relation} {limit:.3g}")
    if claim.subject == MODIFIED and OPTIMUM in checks and not own.ok:
        best = checks[OPTIMUM]
        able = "the optimum meets it" if best.ok else "not even the optimum of this game meets it"
        parts.append(f"{able} ({best.value:.3g})")
    return "; ".join([*parts, *([claim.why] if claim.why else [])])
