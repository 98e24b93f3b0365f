"""Verdict on a critic: its checks, its cost, the likely mistake, and its report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.cost import FlightCost
from hfa_support.reporting.checks import Check, Checked, verdict_text
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.results import Result, given
from hfa_support.reporting.text import Cell, Table, entry_rows
from verification.box import Box
from verification.critic_errors import Exact
from verification.nonlinear_game import NonlinearComparison

#: Number of entries of P and K in a report, and in the report of a critic that fails. Files contain
#: all entries.
_ENTRIES = 12
_ENTRIES_OF_A_FAILURE = 3
#: Number of failures printed with their reasons; of further ones only the names are printed.
_FAILURES = 6
#: Relative difference of an entry, or cost above the optimum in percent, that is rounding.
ROUNDING = 1e-9
#: Largest cost above the optimum, percent, of a critic with grade "near".
NEAR = 1.0
#: Largest distance of an equilibrium from the trim, as a fraction of the box, with which the cost
#: decides: from there, the cost that counts from the equilibrium is that from the trim.
AT_TRIM = 1e-6
#: Kinds of checks that the first lines always mention. Another failed check is told by its reason.
_IN_THE_FACTS = ("error", "rest", "stability", "game loop")
#: Checks of the gain K.
_OF_K = ("K_rel_error", "K_balanced_error", "K_entry_error")
#: What to compare if no mistake is recognized.
UNEXPLAINED = (
    "Compare signs, units and order of states and inputs, Q, R, delta, discount and dt "
    "with those of the training"
)
#: Largest number of columns of the first line of a report.
_FIRST_LINE = 80


@dataclass(frozen=True, eq=False)
class Details(Result):
    """Optional data of a verdict besides its checks.

    graded: cost above the optimum, L2 gain, distance to instability; with a limit of the cost, also
        the limit and the verdict on the cost.
    disk_margin: disk margin of K.
    disk_margin_exact: disk margin of the exact gain.
    discount: discount factor of one step.
    box: half-widths of the box of states in which V and the policies are compared, and their
        source.
    dt: sampling time of a sampled plant, s.
    network: for a critic that is not quadratic, its outputs, V(0), the largest errors found
        in the box, and the results of its simulations.
    """

    graded: FlightCost | None = None
    disk_margin: float | None = None
    disk_margin_exact: float | None = None
    discount: float | None = None
    box: Box | None = None
    dt: float | None = None
    network: Mapping[str, Any] | None = None


class Section(NamedTuple):
    """Part of the report on a critic, with its data.

    part: text or table of the report
    data: entries that the part adds to the data of the verdict
    records: table for a data file in place of the entries of P and K, or None
    """

    part: Part
    data: Details
    records: Table | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Checked, Result, Reported):
    """Verdict on one critic, which passes if every check passes.

    critic: the critic.
    exact: the certified solution.
    checks: the checks, each of kind error, rest, stability, game loop, cost, gain or data.
    limit: limit of the errors.
    reason: the recognized mistake, or "".
    cost_lost: upper bound of the cost above the optimum, percent.
    game: the game in the first line, such as "linear game".
    solution: what the exact solution is, for the heading.
    weights: Q, R and delta of the game, and their source, as text.
    box: box of states in which the errors are measured.
    flights: number of simulations of the critic, or None for a quadratic critic, whose cost is
        computed without simulations.
    searched: number of states at which errors in the box were searched for, or 0 if the errors are
        bounds.
    sections: further findings.
    nonlinear: comparison of a critic that is not quadratic with the nonlinear game, or None.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=10.0)
    >>> verdict = hfa.verify(game, hfa.solve(game))
    >>> type(verdict) is hfa.Verdict, verdict.ok
    (True, True)
    """

    schema = "hfa.critic-check/1"

    critic: Critic
    exact: Exact
    checks: tuple[Check, ...]
    limit: float
    reason: str
    cost_lost: float
    game: str
    solution: str
    weights: str
    box: Box
    flights: int | None = None
    searched: int = 0
    sections: tuple[Section, ...] = ()
    nonlinear: NonlinearComparison | None = None

    @property
    def ok(self) -> bool:
        """True if every check passes, and the critic also passes on the nonlinear game, if it was
        judged there.
        """
        return self._passes_checks and (self.nonlinear is None or self.nonlinear.ok)

    @property
    def _passes_checks(self) -> bool:
        return all(check.ok for check in self.checks)

    def value_of(self, name: str) -> float:
        """Return the measured value of a check with this name, or nan if there is no such check."""
        return next((check.value for check in self.checks if check.name == name), math.nan)

    @property
    def P_rel_error(self) -> float:
        """Relative error |P - P*| / |P*| in Frobenius norms and the units of the game.

        The value is nan if only a gain is known.
        """
        return self.value_of("P_rel_error")

    @property
    def K_rel_error(self) -> float:
        """Relative error |K - K*| / |K*| in Frobenius norms and the units of the game."""
        return self.value_of("K_rel_error")

    @property
    def largest_error(self) -> float:
        """Largest measured value of the checks of kind "error"."""
        return max(check.value for check in self.checks if check.kind == "error")

    @property
    def stabilizing(self) -> bool:
        """True if A - B K is stable."""
        return all(check.ok for check in self.checks if check.kind == "stability")

    def holds(self, limit_cost: float | None = None) -> bool:
        """Return whether the critic passes.

        limit_cost: limit of the cost above the optimum, percent. With a limit, the cost decides, on
            the nonlinear game also that of its flights, if the loop is stable and the equilibrium
            is at the trim (`AT_TRIM`). With None, all checks must pass.
        """
        return self._linear_holds(limit_cost) and self._nonlinear_holds(limit_cost)

    def _linear_holds(self, limit_cost: float | None) -> bool:
        """Return whether the critic passes on the game itself."""
        if limit_cost is None:
            return self._passes_checks
        return self.cost_lost <= limit_cost and self._rests_at_trim and self.stabilizing

    def _nonlinear_holds(self, limit_cost: float | None) -> bool:
        """Return whether the critic passes on the nonlinear game, True if it was not judged there.

        A limit of the cost decides if flights were simulated.
        """
        if self.nonlinear is None:
            return True
        flown = self.nonlinear.flown
        if limit_cost is None or flown is None:
            return self.nonlinear.ok
        return 100.0 * flown.excess <= limit_cost

    @property
    def _rests_at_trim(self) -> bool:
        """True unless the equilibrium of a simulated critic is off the trim."""
        rests = [check.value for check in self.checks if check.kind == "rest"]
        return all(distance <= AT_TRIM for distance in rests)

    @property
    def grade(self) -> str:
        """Grade of the critic: "exact", "near" or "fail".

        - "exact": every check passes.
        - "near": the only failed checks are those of errors, the equilibrium is at the trim
          (`AT_TRIM`), and the cost is at most `NEAR` percent above the optimum.
        - "fail": all other cases, and a critic that fails on the nonlinear game.
        """
        if self.nonlinear is not None and not self.nonlinear.ok:
            return "fail"
        return self._grade_of_checks

    @property
    def _grade_of_checks(self) -> str:
        """The grade without the nonlinear game."""
        if self._passes_checks:
            return "exact"
        for check in self.checks:
            if not (check.ok or check.kind in ("error", "rest")):
                return "fail"
        is_near = self.cost_lost <= NEAR and self._rests_at_trim
        return "near" if is_near else "fail"

    @property
    def headline(self) -> str:
        """First line of the report: the grade, the game, the box, the number of
        simulations of a critic that is not quadratic, and the first finding.

        The first findings on such a critic are its cost, its equilibrium and its gain K.

        The second finding is added if the line then has at most `_FIRST_LINE` columns.
        """
        return self._first_lines(None)[0]

    def _first_lines(self, limit_cost: float | None) -> list[str]:
        """Return the headline of the report, and a line for each further finding."""
        first, second, *others = self._facts()
        headline = f"{self._grade_text(limit_cost)} {self._scope()}: {first}"
        if len(headline) + len(second) + 2 <= _FIRST_LINE:
            headline += f", {second}"
        else:
            others = [second, *others]
        if limit_cost is not None:
            others = [f"decided by the cost limit {limit_cost:g} %", *others]
        if self.nonlinear is None:
            return [headline, *others]
        return [*self._nonlinear_lines(self.nonlinear, limit_cost), headline, *others]

    def _scope(self) -> str:
        """Return on which game and in which box, and with how many simulations."""
        scope = f"on the {self.game}, {self.box.name}"
        if self.nonlinear is not None:
            scope = f"of the linear part on the {self.game}"
        if self.flights is not None:
            scope += f", {self.flights or 'no'} flight{'' if self.flights == 1 else 's'}"
        return scope

    def _facts(self) -> list[str]:
        """Return at least two findings, the most important one first.

        They are a failed check that no other finding mentions, the cost (of a simulated critic with
        equilibrium and K), exactness and stability (first if not stabilizing), and the L2 gain.
        """
        failed = [check for check in self.checks if not check.ok]
        facts = []
        if failed and not any(check.kind in _IN_THE_FACTS for check in failed):
            facts.append(failed[0].reason)
        facts += [self._cost_text()] if self.flights is None else self._network_facts()
        if not self.stabilizing:
            facts.append("not stabilizing")
        facts.append(self._exactness(failed))
        if self.stabilizing:
            facts.append("stabilizing")
        gain = next((check for check in self.checks if check.kind == "gain"), None)
        if gain is not None and math.isfinite(gain.value):
            facts.append(f"L2 gain {gain.value:.4g} (delta {gain.limit:g})")
        return facts

    def _nonlinear_lines(
        self, nonlinear: NonlinearComparison, limit_cost: float | None
    ) -> list[str]:
        """Return the headline of both games, and a line for each finding on the nonlinear game."""
        flown = nonlinear.flown
        about = "near the trim" if flown is None else f"in {flown.where}"
        headline = (
            f"{verdict_text(self._nonlinear_holds(limit_cost))} on the nonlinear game {about}, "
            "linear part"
            f" {self._grade_text(limit_cost)}"
        )
        findings = [nonlinear.sentence]
        if flown is not None:
            # The sentence on the flights is first if they decide that the critic fails.
            findings = [nonlinear.sentence, flown.sentence]
            if not flown.ok:
                findings.reverse()
        return [headline, *(f"Nonlinear game: {finding}" for finding in findings)]

    def _cost_text(self) -> str:
        """Return the cost of the critic relative to the optimum, as text."""
        if math.isinf(self.cost_lost):
            return "cost without bound"
        text = f"{self.cost_lost:.2g} % above the optimum"
        if self.cost_lost < ROUNDING:
            text = "optimal cost"
        return text if self._rests_at_trim else f"{text} about its equilibrium"

    def _network_facts(self) -> list[str]:
        """Return the cost, the equilibrium and the gain K of a simulated critic, as text.

        An equilibrium off the trim comes first: the cost counts from it.
        """
        facts = [self._cost_text()]
        for check in self.checks:
            if check.kind == "rest":
                at_trim = "equilibrium at the trim" if check.ok else check.reason
                facts.insert(int(self._rests_at_trim), at_trim)
        wrong = [check for check in self.checks if check.name in _OF_K and not check.ok]
        exact = f"K exact within {self.limit:g}"
        return [*facts, wrong[0].reason.partition(":")[0] if wrong else exact]

    def grade_text(self, limit_cost: float | None = None) -> str:
        """Return the grade as text: PASS, NEAR or FAIL.

        limit_cost: limit of the cost above the optimum, percent, or None. With a limit, the text is
            PASS or FAIL.
        """
        if not self._nonlinear_holds(limit_cost):
            return verdict_text(False)
        return self._grade_text(limit_cost)

    def _grade_text(self, limit_cost: float | None) -> str:
        """Return the grade on the game of the first line as text."""
        if limit_cost is None and self._grade_of_checks == "near":
            return Cell("NEAR", "bad")
        if limit_cost is None:
            return verdict_text(self._passes_checks)
        return verdict_text(self._linear_holds(limit_cost))

    def _exactness(self, failed: Sequence[Check]) -> str:
        said = () if self.flights is None else _OF_K
        errors = (check for check in failed if check.kind == "error" and check.name not in said)
        wrong = next(errors, None)
        if wrong is not None:
            if self.critic.network and self.reason:
                return f"not exact: {self.reason}"
            return f"not exact ({wrong.reason.partition(':')[0]})"
        if self.searched:
            return f"no error above {self.limit:g} found at {self.searched} states"
        return f"exact within {self.limit:g}"

    def data(self, limit_cost: float | None = None) -> dict[str, Any]:
        """Return the data of the verdict for files.

        limit_cost: limit of the cost above the optimum, percent, or None. With a limit, the entry
            `graded` also contains the limit and the verdict on the cost.
        """
        data = self.as_data()
        if limit_cost is not None and "graded" in data:
            data["graded"] |= {"limit_cost_percent": limit_cost, "ok": self.holds(limit_cost)}
        return data

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value, with those of all sections."""
        entries = {
            "P": self.critic.P,
            "K": self.critic.K,
            "P_exact": self.exact.P,
            "K_exact": self.exact.K,
            "diagnosis": self.reason,
            "ok": self.ok,
            "P_rel_error": self.P_rel_error,
            "K_rel_error": self.K_rel_error,
            "grade": self.grade,
            "checks": [check.contents() | {"kind": check.kind} for check in self.checks],
        } | given(nonlinear=self.nonlinear)
        for section in self.sections:
            entries |= section.data.contents()
        return entries

    def report(
        self, *, limit_cost: float | None = None, about: Sequence[str] = (), source: str = ""
    ) -> Report:
        """Return a report of the verdict: first lines, checks, sections, and entries of P and K.

        limit_cost: as for `holds`
        about: lines below the heading, instead of `weights`
        source: file of the critic, or "" if there is none
        """
        names = self.exact.names
        P = self.critic.P
        values = () if P is None else (P, self.exact.P)
        entries = entry_rows(values, (self.critic.K, self.exact.K), names)
        records = Table(("matrix", "row", "column", "learned", "exact", "unit"), entries)
        for section in self.sections:
            records = section.records or records
        critic = f"Critic of {source}" if source else "Critic"
        heading = [f"{critic} on {names.origin}, against the exact {self.solution}"]
        heading += about or (self.weights,)
        if self.reason:
            where = "" if self.nonlinear is None else f", on the {self.game}"
            heading.append(f"Reason{where}: {self.reason}")
        if self._is_unexplained:
            heading.append(UNEXPLAINED)
        return Report(
            "\n".join(self._first_lines(limit_cost)),
            [
                tuple(heading),
                checks_part(self.checks),
                *(section.part for section in self.sections),
                self._farthest_entries(entries, names.states),
            ],
            data={
                "state_units": list(names.state_units),
                "input_units": list(names.input_units),
                **self.data(limit_cost),
            },
            records=records,
        )

    @property
    def _is_unexplained(self) -> bool:
        """True if it helps to compare the game with that of the training; of a network, if K is
        wrong.
        """
        if self.critic.network:
            is_wrong = any(check.name in _OF_K and not check.ok for check in self.checks)
            return is_wrong and self.grade == "fail" and not self.reason
        return not (self.ok or self.reason)

    def plot(self) -> np.ndarray:
        """Draw the learned and the exact P, or K without P, with pyplot, and return the Axes."""
        import verification
        from hfa_support.reporting.figure import pyplot_figure

        return np.array(verification.verdict_figure(self, pyplot_figure).axes)

    def _farthest_entries(
        self, entries: Sequence[tuple[Any, ...]], states: tuple[str, ...]
    ) -> Part:
        """Return a table of the entries of P and K with the largest relative errors."""
        largest = {
            "P": float(np.abs(self.exact.P).max()) or 1.0,
            "K": float(np.abs(self.exact.K).max()) or 1.0,
        }
        candidates = [
            entry
            for entry in entries
            if entry[0] == "K" or states.index(entry[1]) <= states.index(entry[2])
        ]
        errors = [
            abs(learned - exact) / largest[matrix] for matrix, _, _, learned, exact, _ in candidates
        ]
        sizes = np.nan_to_num(np.array(errors), nan=np.inf)
        sizes[sizes < ROUNDING] = 0.0  # rounding would determine the largest
        if not sizes.any():
            return ()
        most = _ENTRIES if self.ok else _ENTRIES_OF_A_FAILURE
        rows = []
        for index in sorted(np.argsort(-sizes, kind="stable")[:most]):
            matrix, row, column, learned, exact, _ = candidates[index]
            rows.append(
                (
                    f"{matrix}({row}, {column})",
                    f"{learned:.8g}",
                    f"{exact:.8g}",
                    f"{learned - exact:+.2e}",
                )
            )
        table = Table(("entry", "learned", "exact", "difference"), rows)
        if len(candidates) <= most:
            return (table,)
        which = f"the {most} of {len(candidates)} entries with the largest errors"
        return (table, f"{which}; -o FILE writes all")


def explained(checks: Sequence[Check], diagnosis: str) -> tuple[Check, ...]:
    """Return the checks, with the recognized mistake in the reason of the first failed check.

    The checks are unchanged if this reason already contains the mistake.

    diagnosis: the recognized mistake, or ""
    """
    with_reason = list(checks)
    for index, check in enumerate(checks):
        if not check.ok:
            if diagnosis.startswith(check.reason):
                with_reason[index] = replace(check, reason=diagnosis)
            elif diagnosis not in check.reason:
                with_reason[index] = replace(check, reason=f"{check.reason}: {diagnosis}")
            break
    return tuple(with_reason)


def checks_part(checks: Sequence[Check]) -> Part:
    """Return a line for each failed check with its reason, and the number of passed checks.

    An error in balanced units or of an entry is left out if that of the whole matrix is named.
    """

    def order(check: Check) -> tuple[bool, bool]:
        return check.kind == "error", check.name not in ("P_rel_error", "K_rel_error")

    failed = sorted((check for check in checks if not check.ok), key=order)
    passed = len(checks) - len(failed)
    for matrix in "PK":
        if any(check.name == f"{matrix}_rel_error" for check in failed):
            others = (f"{matrix}_balanced_error", f"{matrix}_entry_error")
            failed = [check for check in failed if check.name not in others]
    lines = [
        f"FAIL {check.name}: {check.reason} (must be {check.relation} {check.limit:.3g})"
        for check in failed[:_FAILURES]
    ]
    if len(failed) > _FAILURES:
        lines.append(f"FAIL too: {', '.join(check.name for check in failed[_FAILURES:])}")
    lines.append(f"{passed} check{'' if passed == 1 else 's'} passed")
    return tuple(lines)


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
                _shown(verdict.P_rel_error),
                _shown(verdict.K_rel_error),
                _shown(verdict.largest_error),
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
        data={
            "schema": "hfa.critic-checks/1",
            "ok": ok,
            "critics": {name: verdict.data(limit_cost) for name, verdict in verdicts.items()},
        },
        records=Table(header, rows),
    )


def _shown(value: float) -> str:
    """Return a number as text with three digits, or "" for nan."""
    return "" if math.isnan(value) else f"{value:.3g}"
