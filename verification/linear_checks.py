"""Checks of a critic's linear loop and of its value, against the exact solution of its game."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.riccati.excess import Excess, excess_of, without_bound
from controller.riccati.gare import Solution
from hfa_support.reporting.checks import Check, at_least
from hfa_support.reporting.results import Result, Vector, without_empty
from hfa_support.reporting.text import Table, percent
from trim.linear.margins import DiskMargin
from verification.verdict import Section


@dataclass(frozen=True)
class GradedLoop(Result):
    """Cost, L2 gain and distance to instability of u = -K z, and those of the optimum.

    worst: upper bound of the largest cost above the optimum over all initial states, percent; inf
        without a bound
    mean: mean over initial states with the same optimal cost, percent
    at: initial state with the largest excess, at the edge of the box, (n,), or None without one
    gain, exact_gain: L2 gain, which must be below delta
    distance, exact_distance: smallest change of A - B K that gives an undamped mode, relative to
        the norm of A - B K in balanced units; 0 for an unstable loop
    """

    worst: float
    mean: float
    at: Vector | None
    gain: float
    exact_gain: float
    distance: float
    exact_distance: float

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "cost_lost_worst_percent": self.worst,
            "cost_lost_mean_percent": self.mean,
            "l2_gain": self.gain,
            "l2_gain_exact": self.exact_gain,
            "distance_to_instability": self.distance,
            "distance_to_instability_exact": self.exact_distance,
        } | without_empty(worst_initial_state=self.at)


class LinearLoop(NamedTuple):
    """Verdict on the linear loop u = -K z of a critic.

    checks: stability, and in continuous time the L2 gain.
    excess: cost above the optimum, enclosed.
    section: section of the report, with the cost, gain and margins.
    """

    checks: list[Check]
    excess: Excess
    section: Section


def linear_loop(exact: Solution, critic: Critic, box: np.ndarray, is_exact: bool) -> LinearLoop:
    """Return the verdict on the loop u = -K z.

    A - B K must be stable, and its L2 gain must be below delta, unless delta is inf or K is not
    finite. In discrete time, √α (A - B K) must be stable too, otherwise the cost is infinite.

    box: half-widths of the box of states, (n,)
    is_exact: whether the critic equals the exact solution, for the texts
    """
    game, K = exact.game, critic.K
    excess = excess_of(game, K, box) if critic.is_finite else without_bound(game)
    graded = _graded_loop(exact, critic, excess)
    checks = _stability_checks(exact, critic, excess, is_exact)
    if math.isfinite(game.delta) and critic.is_finite:
        reason = f"the closed loop has an L2 gain of {graded.gain:.4g}, not below delta"
        # The cost has a bound if and only if the gain is below delta.
        has_bound = excess.matrix is not None
        checks.append(_proved_check("l2_gain", graded.gain, game.delta, has_bound, reason, "gain"))
    return LinearLoop(checks, excess, _loop_section(exact, K, excess, graded))


def _proved_check(name: str, value: float, limit: float, ok: bool, reason: str, kind: str) -> Check:
    """Return the check that a value is below a limit, decided by a proof: the value is rounded."""
    return Check(name, value, limit, ok, "" if ok else reason, "<", kind)


def _stability_checks(
    exact: Solution, critic: Critic, excess: Excess, is_exact: bool
) -> list[Check]:
    """Return the checks that A - B K is stable, and in discrete time of a finite cost.

    is_exact: whether K is that of the exact solution
    """
    game = exact.game
    poles = exact.level.poles(critic.K)
    if not game.is_discrete:
        value = poles.abscissa
        unstable = f"A - B K is not Hurwitz (abscissa {value:+.3g} 1/s)"
        name = "control_loop_abscissa"
        return [_proved_check(name, value, 0.0, excess.is_stable, unstable, "stability")]
    value = poles.spectral_radius
    unstable = f"A - B K has the spectral radius {value:.7g}"
    if is_exact:
        why = "the exact solution of this discounted problem does not stabilize either"
        unstable = f"{unstable}: {why}"
    discounted = math.sqrt(game.discount) * value
    infinite = f"sqrt(discount) (A - B K) has the spectral radius {discounted:.7g}"
    name = "discounted_loop_radius"
    return [
        _proved_check("control_loop_radius", value, 1.0, excess.is_stable, unstable, "stability"),
        _proved_check(name, discounted, 1.0, excess.is_summable, infinite, "cost"),
    ]


def _graded_loop(exact: Solution, critic: Critic, excess: Excess) -> GradedLoop:
    """Return cost, L2 gain and distance to instability of a loop, and those of the optimum."""
    is_stable = excess.is_stable
    return GradedLoop(
        worst=100.0 * excess.high,
        mean=100.0 * excess.mean,
        at=excess.worst if _has_worst(excess) else None,
        gain=exact.level.l2_gain(critic.K).high if is_stable else math.inf,
        exact_gain=exact.l2_gain,
        distance=exact.level.distance(critic.K) if is_stable else 0.0,
        exact_distance=exact.level.distance(exact.K),
    )


def _loop_section(exact: Solution, K: np.ndarray, excess: Excess, graded: GradedLoop) -> Section:
    """Return the section with cost, gain, distance to instability and margins of a loop."""
    game = exact.game
    learned = exact.level.disk_margin(K) if excess.is_stable else None
    best = exact.disk_margin
    rows = [
        ("% above the optimum, worst case", _percent(excess, excess.high), "0"),
        ("% above the optimum, mean over cases", _percent(excess, excess.mean), "0"),
        ("L2 gain", f"{graded.gain:.4g}", f"{graded.exact_gain:.4g}"),
        ("distance to instability", f"{graded.distance:.3g}", f"{graded.exact_distance:.3g}"),
        ("margin of all inputs, disk", _margin(learned, "disk"), _margin(best, "disk")),
        ("margin of all inputs, gain", _margin(learned, "gain"), _margin(best, "gain")),
        ("margin of all inputs, phase, deg", _margin(learned, "phase"), _margin(best, "phase")),
    ]
    data = without_empty(
        graded=graded,
        disk_margin=math.nan if learned is None else learned.disk,
        disk_margin_exact=math.nan if best is None else best.disk,
        discount=game.discount if game.is_discrete else None,
        dt=None if game.dt is True else game.dt,
    )
    table = Table(("linear loop with the worst disturbance", "learned", "exact"), rows)
    return Section((table, *_state_lines(exact, excess)), data)


def _state_lines(exact: Solution, excess: Excess) -> list[str]:
    """Return lines on the initial states that cost most, relative to the optimum."""
    lines = []
    if _has_worst(excess):
        lines.append(f"Worst initial state, in the box: {state_text(exact, excess.worst)}")
    if excess.free_state is not None:
        lines.append(
            f"From {state_text(exact, excess.free_state)}, the policy costs "
            f"{excess.from_free:.3g}, and the optimum 0"
        )
    return lines


def _has_worst(excess: Excess) -> bool:
    """Return whether some initial state costs most; of an optimal policy, rounding decides it."""
    return not excess.is_optimal and bool(np.isfinite(excess.worst).all())


def state_text(exact: Solution, state: np.ndarray) -> str:
    """Return a state as text, without the entries that print as 0."""
    names = exact.names
    return ", ".join(
        f"{name} {value:.3g}{'' if unit in ('', '1') else f' {unit}'}"
        for name, value, unit in zip(names.states, state, names.state_units, strict=True)
        if value
    )


def value_check(exact: Solution, P: np.ndarray, box: np.ndarray, limit: float) -> Check:
    """Return the check that P of a critic is not indefinite.

    In units of the box, its smallest eigenvalue is at least 0, or that of P* as rounded if this is
    below, minus the change that |P - P*| <= limit |P*| permits (Weyl).

    P: (n, n)
    box: half-widths of the box of states, (n,)
    limit: limit of the relative errors
    """
    scales = np.outer(box, box)
    of_exact = np.linalg.eigvalsh(exact.P * scales)
    size = float(np.abs(of_exact).max())
    smallest = float(np.linalg.eigvalsh((P + P.T) / 2.0 * scales)[0])
    unit = size or 1.0
    indefinite = f"P is indefinite (smallest eigenvalue {smallest / unit:.3g} of the exact P)"
    least = min(0.0, float(of_exact[0])) / unit - limit
    return at_least("P_smallest_eigenvalue", smallest / unit, least, indefinite, kind="cost")


def _percent(excess: Excess, ratio: float) -> str:
    """Return a ratio in percent as text, 0 if no cost differs from the optimum as a double."""
    return "0" if excess.is_optimal else percent(100.0 * ratio, 3).removesuffix(" %")


def _margin(margin: DiskMargin | None, name: str) -> str:
    """Return a number of a disk margin as text, "-" without one."""
    return "-" if margin is None else f"{getattr(margin, name):.4g}"
