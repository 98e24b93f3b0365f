"""The verdict on a critic, and what it says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_model.reporting.checks import Check, checks_block
from hfa_model.reporting.report import Block, Report, Reported
from hfa_model.reporting.text import Table, numbered
from hfa_model.support.jsonable import finite_or_none
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import Box
from verification.critic.critic_history import HistoryErrors
from verification.critic.flight_cost import FlightCost
from verification.meaning.margins import DiskMargin
from verification.riccati.gare import GameSolution

#: Entries of P and K in a report; files have all.
SHOWN = 12
_ROUNDING = 1e-9
SCHEMA = "hfa.critic-check/1"


@dataclass(frozen=True, eq=False, repr=False)
class CriticCheck(Reported):
    """The verdict on one critic.

    exact: the certified solution. candidate: what was checked. learned_margin, exact_margin: disk margins of both
    gains, None for one that does not stabilize. flight: what the critic costs. diagnosis: the mistake recognized, or
    "". box: of the states over which V, its slopes and the policies were compared. history: the errors over time, of
    a history.
    """

    exact: GameSolution
    candidate: Candidate
    checks: tuple[Check, ...]
    learned_margin: DiskMargin | None
    exact_margin: DiskMargin
    flight: FlightCost
    diagnosis: str
    box: Box
    history: HistoryErrors | None = None

    @property
    def ok(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)

    @property
    def P_rel_error(self) -> float:
        """|P - P*| / |P*|, Frobenius norms in the units of the game; nan when only a gain was given."""
        return self._value_of("P_rel_error")

    @property
    def K_rel_error(self) -> float:
        """|K - K*| / |K*|, Frobenius norms in the units of the game."""
        return self._value_of("K_rel_error")

    def report(self) -> Report:
        """What the check says, states and inputs by number."""
        return check_report(self)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        candidate = self.candidate
        return {
            "schema": SCHEMA,
            "ok": self.ok,
            "P_rel_error": finite_or_none(self.P_rel_error),
            "K_rel_error": finite_or_none(self.K_rel_error),
            "diagnosis": self.diagnosis,
            "checks": [check.to_dict() for check in self.checks],
            "P": None if candidate.P is None else candidate.P.tolist(),
            "K": candidate.K.tolist(),
            "P_exact": self.exact.P.tolist(),
            "K_exact": self.exact.K.tolist(),
            "disk_margin": None if self.learned_margin is None else self.learned_margin.disk,
            "disk_margin_exact": self.exact_margin.disk,
            "graded": self.flight.to_dict(),
            "box": self.box.to_dict(),
            **({} if self.history is None else {"history": self.history.to_dict()}),
        }

    def _value_of(self, name: str) -> float:
        return next((check.value for check in self.checks if check.name == name), math.nan)


def check_report(
    check: CriticCheck,
    states: tuple[str, ...] = (),
    inputs: tuple[str, ...] = (),
    origin: str = "the plant",
    limit_cost: float | None = None,
) -> Report:
    """The verdict, every check, margins and cost beside the exact ones, and P and K entry by entry.

    states, inputs: names, by default x1, x2, ... and u1, u2, ...; limit_cost: percent, says whether the cost is kept.
    """
    m, n = check.exact.K.shape
    states, inputs = states or numbered("x", n), inputs or numbered("u", m)
    records = _entries(check, states, inputs)
    shown, left_out = _worst(check, records, states)
    said = [f"Reason: {check.diagnosis}"] if check.diagnosis else []
    if limit_cost is not None:
        kept = "PASS" if check.flight.within(limit_cost) else "FAIL"
        said.append(f"Cost in flight, at most {limit_cost:g} percent above the optimum: {kept}")
    return Report(
        title=f"Critic on {origin}, against the exact game solution: {'PASS' if check.ok else 'FAIL'}",
        parts=(
            *said,
            checks_block(check.checks),
            f"Box of states: {check.box.about}",
            _margins(check),
            _cost(check),
            *(() if check.history is None else (check.history.block(),)),
            Block((Table(("entry", "learned", "exact", "difference"), shown), *left_out)),
        ),
        data=check.to_dict() if limit_cost is None else _with_limit(check, limit_cost),
        records=records if check.history is None else check.history.records(),
    )


def _entries(check: CriticCheck, states: tuple[str, ...], inputs: tuple[str, ...]) -> Table:
    """Rows (matrix, row, column, learned, exact) of P, where known, and K."""
    pairs: list[tuple[str, tuple[str, ...], Any, Any]] = [("K", inputs, check.candidate.K, check.exact.K)]
    if check.candidate.P is not None:
        pairs.insert(0, ("P", states, check.candidate.P, check.exact.P))
    rows = [
        (name, row, column, learned[i, j], exact[i, j])
        for name, row_names, learned, exact in pairs
        for i, row in enumerate(row_names)
        for j, column in enumerate(states)
    ]
    return Table(("matrix", "row", "column", "learned", "exact"), rows)


def _worst(check: CriticCheck, entries: Table, states: tuple[str, ...]) -> tuple[list[tuple[str, ...]], list[str]]:
    """The `SHOWN` entries that are farthest off, each relative to the largest of its matrix, in their order; and a line
    that says so where there are more."""
    largest = {"P": float(np.abs(check.exact.P).max()) or 1.0, "K": float(np.abs(check.exact.K).max()) or 1.0}
    rows = [row for row in entries.rows if row[0] == "K" or states.index(row[1]) <= states.index(row[2])]
    off = np.array([abs(learned - exact) / largest[name] for name, _, _, learned, exact in rows])
    off[off < _ROUNDING] = 0.0  # which of them are the largest is chance
    kept = sorted(np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable")[:SHOWN].tolist())
    shown: list[tuple[str, ...]] = [
        (f"{name}({row}, {column})", f"{learned:.8g}", f"{exact:.8g}", f"{learned - exact:+.2e}")
        for name, row, column, learned, exact in (rows[place] for place in kept)
    ]
    more = len(rows) > SHOWN
    return shown, [f"the {SHOWN} of {len(rows)} entries that are farthest off; -o FILE has all"] if more else []


def _margins(check: CriticCheck) -> Table:
    learned, exact = check.learned_margin, check.exact_margin
    rows = [
        (said, "-" if learned is None else f"{getattr(learned, name):.4g}", f"{getattr(exact, name):.4g}")
        for said, name in (("disk", "disk"), ("gain", "gain"), ("phase, deg", "phase"))
    ]
    return Table(("margins, all inputs", "learned", "exact"), rows)


def _cost(check: CriticCheck) -> Table:
    flight = check.flight
    rows = [
        ("cost lost, worst start, percent", f"{flight.worst:.3g}", "0"),
        ("cost lost, mean over starts, percent", f"{flight.mean:.3g}", "0"),
        ("L2 gain", f"{flight.gain:.4g}", f"{flight.exact_gain:.4g}"),
        ("distance to instability", f"{flight.distance:.3g}", f"{flight.exact_distance:.3g}"),
    ]
    return Table(("in flight, under the worst disturbance", "learned", "exact"), rows)


def _with_limit(check: CriticCheck, limit_cost: float) -> dict[str, Any]:
    data = check.to_dict()
    limited = {"limit_cost_percent": limit_cost, "ok": check.flight.within(limit_cost)}
    return data | {"graded": data["graded"] | limited}
