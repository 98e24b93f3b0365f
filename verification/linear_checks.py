"""Checks of a critic's linear loop and of its value, against the exact solution of its game."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.gare import Solution
from controller.riccati.suboptimality import Suboptimality, suboptimality_of, without_bound
from hfa_support.cached import cached_property
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Check, at_least
from hfa_support.reporting.results import without_empty
from hfa_support.reporting.text import Table, percent
from trim.linear.margins import DiskMargin
from verification.verdict import NEAR, values_text


class _Robustness(NamedTuple):
    """L2 gain, and disk margin at all inputs, None of an unstable loop."""

    gain: float
    margin: DiskMargin | None


@dataclass(frozen=True, eq=False)
class LinearLoop:
    """Linear loop u = -K z of a critic, and its section of the report, computed when first used.

    exact: solution of the game
    critic: the critic
    box: half-widths of the box of states, (n,)
    is_exact: whether the critic equals the exact solution within the limit of errors; the exact
        loop is then shown only if the critic costs more than `NEAR` percent above the optimum
    """

    exact: Solution
    critic: Critic
    box: np.ndarray
    is_exact: bool

    @cached_property
    def suboptimality(self) -> Suboptimality:
        """Cost above the optimum, enclosed."""
        if not self.critic.is_finite:
            return without_bound(self.exact.game)
        return suboptimality_of(self.exact.enclosure, self.critic.K, self.box)

    @cached_property
    def gain(self) -> float:
        """L2 gain, at most 1e-6 too large; inf for an unstable loop."""
        return (
            self.exact.closed_loops.l2_gain(self.critic.K).high
            if self.suboptimality.is_stable
            else math.inf
        )

    @property
    def checks(self) -> list[Check]:
        """Checks that A - B K is stable and its L2 gain below delta, unless delta is inf or K is
        not finite; in discrete time, √α (A - B K) must be stable too, or the cost is infinite.
        """
        game, loops, K = self.exact.game, self.exact.closed_loops, self.critic.K
        is_stable = self.suboptimality.is_stable  # proved
        stable_below = 1.0 if game.is_discrete else 0.0
        poles = loops.poles(K) if self.critic.is_finite else np.full(1, math.nan)  # of A - B K
        pole = float((np.abs(poles) if game.is_discrete else poles.real).max())
        if game.is_discrete:
            unstable = f"A - B K has the spectral radius {pole:.7g}"
            if self.is_exact:
                why = "the exact solution of this discounted problem does not stabilize either"
                unstable = f"{unstable}: {why}"
            discounted = math.sqrt(game.discount) * pole
            infinite = f"sqrt(discount) (A - B K) has the spectral radius {discounted:.7g}"
            has_cost = self.suboptimality.is_summable
            name = "control_loop_radius"
            others = [
                _proved_check("discounted_loop_radius", discounted, 1.0, has_cost, infinite, "cost")
            ]
        else:
            unstable = f"A - B K is not Hurwitz (abscissa {pole:+.3g} 1/s)"
            name, others = "control_loop_abscissa", []
        stable = _proved_check(name, pole, stable_below, is_stable, unstable, "stability")
        checks = [stable, *others]
        if math.isfinite(game.delta) and self.critic.is_finite:
            is_proved = math.isinf(self.suboptimality.low)
            below = "not below delta" if is_proved else "not proved to be below delta"
            reason = f"the closed loop has an L2 gain of {self.gain:.4g}, {below}"
            # The cost has a bound if and only if the gain is below delta.
            has_bound = self.suboptimality.matrix is not None
            checks.append(
                _proved_check("l2_gain", self.gain, game.delta, has_bound, reason, "gain")
            )
        return checks

    @cached_property
    def robustness(self) -> dict[str, _Robustness]:
        """Robustness of the loop, "learned", and of another optimum, "exact"."""
        exact, closed_loops, K = self.exact, self.exact.closed_loops, self.critic.K
        margin = closed_loops.disk_margin(K) if self.suboptimality.is_stable else None
        found = {"learned": _Robustness(self.gain, margin)}
        if not self.is_exact or 100.0 * self.suboptimality.high > NEAR:
            found["exact"] = _Robustness(exact.l2_gain, exact.disk_margin)
        return found

    @property
    def part(self) -> Part:
        """Table and lines of the report."""
        suboptimality, loops = self.suboptimality, self.robustness.values()
        zeros = ["0"] * (len(loops) - 1)  # of the exact solution, where it has a column
        rows: list[tuple[str, ...]] = []
        ratios = {"worst case": suboptimality.high, "mean over cases": suboptimality.mean}
        if suboptimality.of_each is not None:
            ratios["of one state"] = suboptimality.of_each
        for which, ratio in ratios.items():
            # The ratio of an optimal policy is rounding.
            above = 0.0 if suboptimality.is_optimal else 100.0 * ratio
            rows.append(
                (f"% above the optimum, {which}", percent(above, 3).removesuffix(" %"), *zeros)
            )
        rows.append(("L2 gain", *(f"{loop.gain:.4g}" for loop in loops)))
        for name, unit in (("disk", ""), ("gain", ""), ("phase", ", deg")):
            margins = (
                f"{getattr(loop.margin, name):.4g}" if loop.margin else "-" for loop in loops
            )
            rows.append((f"margin of all inputs, {name}{unit}", *margins))
        table = Table(("linear loop with the worst disturbance", *self.robustness), rows)
        lines = []
        if _has_worst(suboptimality):
            names = self.exact.names
            worst = values_text(names.states, names.state_units, suboptimality.worst)
            lines.append(f"Worst initial state, in the box: {worst}")
        return (table, *lines)

    @property
    def data(self) -> dict[str, Any]:
        """Entries of the verdict's file, name -> value; those of another optimum end in _exact."""
        suboptimality, game = self.suboptimality, self.exact.game
        graded: dict[str, Any] = {
            "cost_above_optimum_worst_percent": 100.0 * suboptimality.high,
            "cost_above_optimum_mean_percent": 100.0 * suboptimality.mean,
        }
        margins = {}
        for whose, loop in self.robustness.items():
            end = "_exact" if whose == "exact" else ""
            graded[f"l2_gain{end}"] = loop.gain
            margins[f"disk_margin{end}"] = loop.margin.disk if loop.margin else math.nan
        if _has_worst(suboptimality):
            graded["worst_initial_state"] = suboptimality.worst
        # Of a network, this is the loop of its linear part alone.
        name = "linear_part" if self.critic.network else "graded"
        return margins | without_empty(
            **{name: graded},
            discount=game.discount if game.is_discrete else None,
            dt=None if game.dt is True else game.dt,
        )


def _proved_check(name: str, value: float, limit: float, ok: bool, reason: str, kind: str) -> Check:
    """Return the check that a value is below a limit, decided by a proof (`ok`) and not by the
    value, which is rounded.
    """
    return Check(name, value, limit, ok, "" if ok else reason, "<", kind)


def _has_worst(suboptimality: Suboptimality) -> bool:
    """Return whether a policy costs most from some initial state, which is known.

    Rounding alone would decide the worst state of an optimal policy.
    """
    return not suboptimality.is_optimal and bool(np.isfinite(suboptimality.worst).all())


def value_check(exact: Solution, P: np.ndarray, box: np.ndarray, limit: float) -> Check:
    """Return the check that P of a critic is not indefinite.

    In units of the box, its smallest eigenvalue must not be below 0 by more than the change that
    |P - P*| <= limit |P*| permits (Weyl); if that of P* is negative by rounding, it takes the place
    of 0.

    P: (n, n)
    box: half-widths of the box of states, (n,)
    limit: limit of the relative errors
    """
    scales = np.outer(box, box)
    of_exact = np.linalg.eigvalsh(exact.P * scales)  # in ascending order
    unit = float(np.abs(of_exact).max()) or 1.0  # of eigenvalues
    smallest = float(np.linalg.eigvalsh((P + P.T) / 2.0 * scales)[0])
    indefinite = f"P is indefinite (smallest eigenvalue {smallest / unit:.3g} of the exact P)"
    least = min(0.0, float(of_exact[0])) / unit - limit
    return at_least("P_smallest_eigenvalue", smallest / unit, least, indefinite, kind="cost")
