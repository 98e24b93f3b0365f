"""Verdict on a critic: its checks, its cost and the likely mistake."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.critic.network.declared import NOTHING
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import SAME_DOUBLE, Suboptimality
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Check, Checked, Report, Reported
from hfa_support.reporting.results import Result, storable, without_empty
from hfa_support.reporting.text import percent
from verification.box import Box
from verification.nonlinear_game import GRADES, NonlinearComparison

#: Cost above the optimum, percent, with which the cost is the same double as the optimum.
OPTIMAL = 100.0 * SAME_DOUBLE
#: Largest cost above the optimum, percent, of a critic with grade "near".
NEAR = 1.0


class Section(NamedTuple):
    """Part of the report on a critic, with its data.

    part: text or table of the report
    data: entries that the part adds to the data of the verdict
    """

    part: Part
    data: Mapping[str, Any] = {}


class CounterExample(NamedTuple):
    """A flight that shows that a policy is not near the optimum.

    start: initial state in the box, (n,)
    what: "diverges", "ends at another equilibrium" or "costs more"
    """

    start: np.ndarray
    what: str


@dataclass
class Proof:
    """What is proved of a policy.

    excess: proved bound of the cost above the optimum of every state of the box, relative to the
        largest optimum of the box; inf if none is proved
    why: why no bound is proved, or none as small as asked, or ""
    share: share of the tube in which the error is proved to be small enough
    boxes: number of boxes
    violators: deviations from the equilibrium at which the error is too large, the worst first
    """

    excess: float = math.inf
    why: str = ""
    share: float = 0.0
    boxes: int = 0
    violators: list[np.ndarray] = field(default_factory=list)

    @property
    def is_found(self) -> bool:
        """Whether a bound is proved."""
        return math.isfinite(self.excess)

    @property
    def left(self) -> str:
        """Why no bound is proved, and in what part of the tube of flights the error is."""
        share = percent(100.0 * self.share, 3)
        return (
            f"{self.why}; the error is bounded in {share} of the tube" if self.boxes else self.why
        )


@dataclass(frozen=True, eq=False, repr=False)
class Verdict(Checked, Result, Reported):
    """Verdict on one critic, which passes if every check passes.

    critic: the critic.
    exact: the certified solution.
    checks: the checks, each of kind error, rest, stability, game loop, cost, gain or data.
    limit: limit of the errors.
    reason: the recognized mistake, or "".
    cost_above_optimum_percent: cost above the optimum, percent: a proved upper bound, or the
        largest of simulations.
    box: box of states in which the errors are measured.
    flights: number of simulations of the critic, or None for a quadratic critic, whose cost is
        computed without simulations.
    proof: what is proved of a critic that is not quadratic, or None for another.
    worst_flight: the simulation with the largest cost, or None.
    searched: number of states at which errors in the box were searched for, or 0 if the errors are
        bounds.
    sections: further findings, each with the `part` and the `data` of a `Section`.
    nonlinear: comparison of a critic that is not quadratic with the nonlinear game, or None.
    suboptimality: enclosed cost of a quadratic critic above the optimum, or None.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[1.0], R=[1.0], delta=10.0)
    >>> verdict = hfa.verify(game, hfa.solve(game))
    >>> type(verdict) is hfa.Verdict, verdict.ok
    (True, True)
    """

    schema = "hfa.critic-check/1"

    critic: Critic
    exact: Solution
    checks: tuple[Check, ...]
    limit: float
    reason: str
    cost_above_optimum_percent: float
    box: Box
    flights: int | None = None
    proof: Proof | None = None
    worst_flight: CounterExample | None = None
    searched: int = 0
    sections: tuple[Any, ...] = ()
    nonlinear: NonlinearComparison | None = None
    suboptimality: Suboptimality | None = None

    @property
    def ok(self) -> bool:
        """True if every check passes, the cost is at most `NEAR` percent above the optimum, and the
        critic also passes on the nonlinear game, if it was judged there.
        """
        return self.holds()

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

        limit_cost: limit of the cost above the optimum, percent. With a limit, the loop must be
            stable, and the cost must be within the limit: that on the linear game, V* at an
            equilibrium off the trim, in percent of V* in the box, and, on the nonlinear game, that
            of flights from the box. With None, all checks must pass, and the limit is `NEAR`.
        """
        return self._grade(limit_cost) == "exact"

    def rests_within(self, limit_cost: float) -> bool:
        """Return whether V* at the equilibrium of a simulated critic is within a limit, percent of
        V* in the box.
        """
        return all(check.value <= limit_cost for check in self.checks if check.kind == "rest")

    @property
    def grade(self) -> str:
        """Grade of the critic: "exact", "near" or "fail".

        - "exact": every check passes, and the cost is at most `NEAR` percent above the optimum.
        - "near": the cost is at most `NEAR` percent above the optimum, and the only failed checks
          are those of errors and of the equilibrium, where V* is at most `NEAR` percent of V* in
          the box; or the critic passes on the nonlinear game in a part of the box alone.
        - "fail": all other cases, and a critic that fails on the nonlinear game.
        """
        return self._grade()

    def _grade(self, limit_cost: float | None = None) -> str:
        """Return the grade, on the nonlinear game too if the critic was judged there.

        limit_cost: as for `holds`; with a limit, the linear game has no grade "near"
        """
        linear_grade = self._linear_grade(limit_cost)
        if self.nonlinear is None:
            return linear_grade
        return max(linear_grade, self.nonlinear.grade(limit_cost), key=GRADES.index)

    def _linear_grade(self, limit_cost: float | None = None) -> str:
        """Return the grade without the nonlinear game, as described at `grade`.

        limit_cost: with a limit, percent, the grade is "exact" if the loop is stable, and the cost
            and V* at the equilibrium are within the limit, else "fail"
        """
        flown = self.cost_above_optimum_percent
        above = self.proved_percent if self.is_proved(limit_cost) else flown
        if limit_cost is not None:
            is_within = above <= limit_cost and self.rests_within(limit_cost)
            return "exact" if is_within and self.stabilizing else "fail"
        failed = {check.kind for check in self.checks if not check.ok}
        if above <= NEAR and not failed:
            return "exact"
        is_near = above <= NEAR and self.rests_within(NEAR)
        return "near" if is_near and failed <= {"error", "rest"} else "fail"

    @property
    def proved_percent(self) -> float:
        """Proved bound of the cost above the optimum, percent, of a critic that is not quadratic;
        inf if none is proved.
        """
        return math.inf if self.proof is None else 100.0 * self.proof.excess

    def is_proved(self, limit_cost: float | None = None) -> bool:
        """Return whether a cost within the limit, by default `NEAR` percent, is proved."""
        return self.proved_percent <= (NEAR if limit_cost is None else limit_cost)

    def has_counterexample(self, limit_cost: float | None = None) -> bool:
        """Return whether a flight costs more than the limit, by default `NEAR` percent."""
        limit = NEAR if limit_cost is None else limit_cost
        return self.worst_flight is not None and self.cost_above_optimum_percent > limit

    def file_entries(self, limit_cost: float | None = None) -> dict[str, Any]:
        """Return the entries of the verdict for files, name -> value.

        limit_cost: limit of the cost above the optimum, percent, or None. With a limit, the entry
            `graded` also contains the limit and the verdict on the cost.
        """
        data = storable(self)
        if limit_cost is not None and "graded" in data:
            data["graded"] |= {"limit_cost_percent": limit_cost, "ok": self.holds(limit_cost)}
        return data

    def _entries(self) -> dict[str, Any]:
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
            "checks": [storable(check) | {"kind": check.kind} for check in self.checks],
        } | without_empty(nonlinear=self.nonlinear)
        if self.critic.declared is not NOTHING:
            entries["declared"] = self.critic.declared
        for section in self.sections:
            entries |= section.data
        return entries

    @property
    def headline(self) -> str:
        """First line of the report."""
        return self.report().title.partition("\n")[0]

    def report(
        self, *, limit_cost: float | None = None, about: Sequence[str] = (), source: str = ""
    ) -> Report:
        """Return a report of the verdict (`verification.verdict_report`).

        limit_cost: as for `holds`
        about: lines below the heading, instead of the weights of the game
        source: file of the critic, or "" if there is none
        """
        import verification

        return verification.verdict_report(self, limit_cost=limit_cost, about=about, source=source)

    def plot(self) -> np.ndarray:
        """Draw the learned and the exact P, or K without P, with pyplot, and return the Axes."""
        import verification
        from hfa_support.reporting.figure import pyplot_figure

        return np.array(verification.verdict_figure(self, pyplot_figure).axes)


def bias_text(critic: Critic, exact: Solution) -> str:
    """Return a sentence on the inputs at the origin, which are not 0."""
    u, names = critic.u(np.zeros(critic.K.shape[1])), exact.names
    return f"u at the origin is {values_text(names.inputs, names.input_units, u)}, not 0: a bias"


def values_text(names: Sequence[str], units: Sequence[str], values: Iterable[float]) -> str:
    """Return values with names and units as text, without those that are 0."""
    return ", ".join(
        f"{name} {value:.3g}{'' if unit in ('', '1') else f' {unit}'}"
        for name, value, unit in zip(names, values, units, strict=True)
        if value
    )
