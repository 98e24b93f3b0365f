"""Report on several critics of one game."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table
from verification.critic.verdict import ROUNDING, Verdict, shown_number


@dataclass(frozen=True, eq=False)
class Verdicts(Result):
    """Verdicts on several critics of one game.

    ok: True if all critics pass.
    critics: file -> verdict of `hfa verify` on this critic alone.
    """

    schema = "hfa.critic-checks/1"
    made_by = "hfa verify of several critics"

    ok: bool
    critics: Mapping[str, Any]


def verdicts_report(
    verdicts: Mapping[str, Verdict], origin: str, limit_cost: float | None = None
) -> Report:
    """Return a report with a table of several critics of one game.

    verdicts: file -> verdict
    origin: name of the plant
    limit_cost: limit of the cost above the optimum, percent. With a limit, only the cost decides
        each verdict. With None, all checks must pass.
    """
    header = (
        "critic",
        "verdict",
        "error of P",
        "error of K",
        "largest error",
        "stabilizing",
        "linear cost, % above the optimum",
        "L2 gain",
    )
    rows = []
    for name, verdict in verdicts.items():
        lost = 0.0 if verdict.cost_lost < ROUNDING else verdict.cost_lost
        gain = verdict.value_of("l2_gain")
        rows.append(
            (
                name,
                verdict.grade_text(limit_cost),
                shown_number(verdict.P_rel_error),
                shown_number(verdict.K_rel_error),
                shown_number(verdict.largest_error),
                "yes" if verdict.stabilizing else "no",
                f"{lost:.3g}",
                "" if math.isnan(gain) else f"{gain:.4g}",
            )
        )
    passed = sum(verdict.holds(limit_cost) for verdict in verdicts.values())
    ok = passed == len(verdicts)
    parts: list[Part] = []
    if limit_cost is not None:
        parts.append(f"Decided by the cost limit {limit_cost:g} percent")
    reasons = [f"{name}: {verdict.reason}" for name, verdict in verdicts.items() if verdict.reason]
    return Report(
        title=f"{verdict_text(ok)}: {passed} of {len(verdicts)} critics pass, on {origin}",
        parts=(*parts, Table(header, rows), tuple(reasons)),
        data=Verdicts(
            ok,
            {name: verdict.data(limit_cost) for name, verdict in verdicts.items()},
        ).as_data(),
        records=Table(header, rows),
    )
