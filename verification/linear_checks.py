"""Checks of a critic's linear loop and of its value, against the exact solution of its game."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.balancing import loop_check
from controller.riccati.certificate import form_of
from controller.riccati.cost import SIGNLESS, FlightCost, flight_cost
from controller.riccati.form import INDEFINITENESS
from controller.riccati.gare import Solution
from controller.riccati.margins import DiskMargin, disk_margin
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.results import without_empty
from hfa_support.reporting.text import Table
from verification.critic_errors import LIMIT
from verification.verdict import ROUNDING, Section


class LinearLoop(NamedTuple):
    """Verdict on the linear loop u = -K z of a critic.

    checks: stability, and in continuous time the L2 gain.
    cost_lost: largest cost above the optimum over all initial conditions, percent, or inf.
    section: section of the report, with the cost, gain and margins.
    """

    checks: list[Check]
    cost_lost: float
    section: Section


def linear_loop(exact: Solution, critic: Critic, is_exact: bool) -> LinearLoop:
    """Return the verdict on the loop u = -K z.

    A - B K must be stable, and its L2 gain must be below delta, unless delta is inf or K is not
    finite. In discrete time, √α (A - B K) must be stable too, otherwise the cost is infinite.

    is_exact: whether the critic equals the exact solution, for the texts
    """
    game, K = exact.game, critic.K
    checks = _stability_checks(game, K, is_exact)
    try:
        cost = flight_cost(exact, K)
    except NoSolutionError:  # rounding hides whether A - B K is stable
        cost = flight_cost(exact, np.full_like(K, math.inf))
    if math.isfinite(game.delta) and critic.is_finite:
        reason = f"the closed loop has an L2 gain of {cost.gain:.4g}, not below delta"
        checks.append(below("l2_gain", cost.gain, game.delta, reason, kind="gain"))
    return LinearLoop(checks, cost.worst, _loop_section(exact, K, cost))


def _stability_checks(game: Game, K: np.ndarray, is_exact: bool) -> list[Check]:
    """Return the checks that A - B K is stable, and in discrete time of a finite cost.

    is_exact: whether K is that of the exact solution
    """
    loop = game.A - game.B @ K
    is_discrete = game.is_discrete
    stable = loop_check("control_loop", "A - B K", loop, is_discrete=is_discrete, kind="stability")
    if not is_discrete:
        return [stable]
    if is_exact and not stable.ok:
        why = "the exact solution of this discounted problem does not stabilize either"
        stable = replace(stable, reason=f"{stable.reason}: {why}")
    discounted = math.sqrt(game.discount) * stable.value
    infinite = f"sqrt(discount) (A - B K) has the spectral radius {discounted:.7g}"
    return [stable, below("discounted_loop_radius", discounted, 1.0, infinite, kind="cost")]


def _loop_section(exact: Solution, K: np.ndarray, cost: FlightCost) -> Section:
    """Return the section with cost, gain, distance to instability and margins of a loop."""
    game = exact.game
    learned, best = _disk_margin(game, K), _disk_margin(game, exact.K)
    rows = [
        ("% above the optimum, worst case", _percent(cost.worst), "0"),
        ("% above the optimum, mean over cases", _percent(cost.mean), "0"),
        ("L2 gain", f"{cost.gain:.4g}", f"{cost.exact_gain:.4g}"),
        ("distance to instability", f"{cost.distance:.3g}", f"{cost.exact_distance:.3g}"),
        ("margin of all inputs, disk", _margin(learned, "disk"), _margin(best, "disk")),
        ("margin of all inputs, gain", _margin(learned, "gain"), _margin(best, "gain")),
        ("margin of all inputs, phase, deg", _margin(learned, "phase"), _margin(best, "phase")),
    ]
    whose = "linear loop with the worst disturbance"
    if game.is_discrete:
        whose += " of the optimum"
    data = without_empty(
        graded=cost,
        disk_margin=math.nan if learned is None else learned.disk,
        disk_margin_exact=math.nan if best is None else best.disk,
        discount=game.discount if game.is_discrete else None,
        dt=None if game.dt is True else game.dt,
    )
    return Section((Table((whose, "learned", "exact"), rows),), data)


def value_checks(exact: Solution, P: np.ndarray, limit: float) -> list[Check]:
    """Return the checks of a critic's P: the residual of its equation, and in continuous time
    the loop A - S P and the sign of P.

    - If Q is singular, a smallest eigenvalue of P down to -`INDEFINITENESS` is permitted.
      Rounding can make the value of a state without cost negative.
    - If the limit is above `LIMIT`, the smallest eigenvalue of P may be lower than that of P*
      by the change that |P - P*| <= limit |P*| permits (Weyl).

    P: (n, n)
    limit: limit of the relative residual
    """
    game = exact.game
    form = form_of(game)
    scaled, right = form.of_value(P), form.of_value(exact.P)
    residual = form.relative_residual(scaled)
    name, equation = "riccati_residual", "the Riccati equation"
    if game.is_discrete:
        name, equation = "bellman_residual", "Bellman's equation"
    unsolved = f"the residual of {equation} is {residual:.2g}"
    solved = at_most(name, residual, limit, unsolved, kind="error")
    if game.is_discrete:
        return [solved]
    loop = game.worst_case_loop((P + P.T) / 2.0)
    costs = np.linalg.eigvalsh(form.Q)
    least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
    if limit > LIMIT and right.any():
        allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
        least = min(least, _smallest_eigenvalue(right) - allowed)
    smallest = _smallest_eigenvalue(scaled)
    indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
    return [
        loop_check("game_loop", "A - S P", loop, is_discrete=False, kind="game loop"),
        at_least("P_smallest_eigenvalue", smallest, least, indefinite, kind="cost"),
        solved,
    ]


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Return the smallest eigenvalue of (P + P')/2, relative to the largest entry of |P|."""
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _disk_margin(game: Game, K: np.ndarray) -> DiskMargin | None:
    """Return the disk margin of u = -K z, or None if the loop is not stable."""
    if not np.isfinite(K).all():
        return None
    with suppress(NoSolutionError):
        return disk_margin(game, K)
    return None


def _percent(excess: float) -> str:
    """Return an excess in percent as text, 0 if it is rounding."""
    return "0" if excess < ROUNDING else f"{excess:.3g}"


def _margin(margin: DiskMargin | None, name: str) -> str:
    return "-" if margin is None else f"{getattr(margin, name):.4g}"
