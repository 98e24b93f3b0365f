"""Check of a learned critic against the exact solution of its game: errors and closed loop."""

from __future__ import annotations

import math
from contextlib import suppress
from functools import lru_cache

import numpy as np

from controller.critic.critic import Critic, from_parts
from controller.critic.training_run import TrainingRun
from controller.game.weights import weights_line
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.certificate import INDEFINITENESS
from controller.riccati.cost import SIGNLESS, FlightCost, flight_cost
from controller.riccati.gare import Solution, unconfirmed_solution
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.normal_form import NormalForm
from hfa_support.arguments import checks_arguments, need
from hfa_support.errors import NoSolutionError, refuse_unless_positive
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.text import Table
from verification.critic_errors import critic_errors
from verification.hfa_box import usual_box
from verification.scope import LIMIT, Scope
from verification.verdict import Details, Section, Verdict, explained

#: What is given as a critic.
_CRITICS = (
    "hfa.from_gain(game, K), hfa.from_value(game, P), hfa.from_weights(game, W, basis=...), "
    "hfa.from_network(game, NETWORK) or hfa.read_critic(FILE, game)"
)


@checks_arguments
def verify(
    game: Game,
    critic: Critic | Solution | TrainingRun,
    *,
    limit: float = LIMIT,
    scope: Scope | None = None,
    run: TrainingRun | None = None,
) -> Verdict:
    """Return the verdict on a critic, compared with the exact solution of its game.

    The checks are:
    - errors of P and K, in norms and entry by entry
    - errors of V, its gradient and both policies in a box of states
    - stability of A - B K and A - S P
    - P not indefinite, and the residual of the Riccati equation
    - an L2 gain below delta

    A critic that is not quadratic is also searched for the largest errors in the box, and simulated
    from states in the box. For a network, a bound on its errors is proved if possible.

    game: the game
    critic: the critic, from `hfa.from_gain`, `from_value`, `from_weights`, `from_network` or
        `hfa.read_critic`; or a solution, or a training run
    limit: limit of the errors and the residual
    scope: further data for the checks; by default `Scope()`
    run: the training run that ends with the critic, or None. The rank of its data and its settling
        time are checked.

    Raises NoSolutionError if the game has no certified solution, and BadInputError if `game` is not
    a game, `critic` is not a critic, or the limit is not positive.

    >>> import hfa
    >>> game = hfa.paper.published_game(hfa.paper.level_model(hfa.aircraft(), 0.2))
    >>> K = hfa.solve(game).K
    >>> hfa.verify(game, hfa.from_gain(game, 1.01 * K)).reason
    'every entry of K is 1.01 times the exact one'
    """
    need(game, Game, "verify: game", "a game: hfa.game(linear, Q, R, delta)")
    refuse_unless_positive("limit", limit)
    scope = scope or Scope()
    if isinstance(critic, TrainingRun):
        run = critic
        critic = run.critic(game)
    if isinstance(critic, Solution):
        critic = from_parts(game, {"P": critic.P, "K": critic.K})
    need(critic, Critic, "verify: critic", _CRITICS)
    exact = unconfirmed_solution(game)
    box = scope.box or usual_box(game)
    lost = _flight_cost(game, exact, critic.K)
    errors = list(critic_errors(game, critic, exact, limit, box))
    loops = _loop_checks(game, critic, lost)
    checks = [*errors, *loops]
    if critic.P is not None and critic.finite:
        checks += _value_checks(game, critic.P, exact.P, limit)
    cost_lost = lost.worst
    states = 0
    proof = None
    sections = [_flight_section(game, critic, lost)]
    if not critic.is_quadratic:
        from verification.axis import InTime
        from verification.network.search import findings_of

        axis = InTime(game, exact)
        findings = findings_of(axis, critic, exact, box.half_widths, limit, scope)
        errors += findings.errors
        checks += findings.checks
        states = findings.states
        proof = findings.proof
        cost_lost = findings.flown.cost_lost_flown_percent
        sections.append(findings.section)
    elif critic.is_layer:
        sections.append(_polynomial_section(critic))
    diagnosis = ""
    table = None
    if run is not None:
        from verification.error_table import rank_check, run_table, time_checks

        table = run_table(game, run, exact)
        rank = rank_check(run)
        checks += [rank, *time_checks(table)]
        diagnosis = rank.reason
    is_wrong = not all(check.ok for check in errors)
    if not diagnosis and critic.finite and is_wrong:
        from verification.reasons.diagnosis import diagnose

        with suppress(NoSolutionError):  # no solution of a nearby game for comparison
            nearby = None if scope.nearby is None else scope.nearby()
            diagnosis = diagnose(game, exact, critic, limit, nearby, box.half_widths)
    return Verdict(
        critic,
        exact,
        explained(checks, diagnosis),
        limit,
        diagnosis,
        cost_lost,
        states,
        proof,
        sections=(Section((f"Box of states: {box.about}",), Details(box=box)), *sections),
        weights=weights_line(game.Q, game.R, game.delta, N=game.N),
        table=table,
    )


def _flight_cost(game: Game, exact: Solution, K: np.ndarray) -> FlightCost:
    """Return the cost, L2 gain and distance to instability of a gain K, compared with the optimum.

    If rounding hides whether A - B K is stable, the cost of K is infinite.

    game: the game
    exact: solution of the game
    K: (m, n)
    """
    try:
        return flight_cost(game, exact, K)
    except NoSolutionError:
        return flight_cost(game, exact, np.full_like(K, math.inf))


def _loop_checks(game: Game, critic: Critic, lost: FlightCost) -> list[Check]:
    """Return the checks that A - B K is stable and that its L2 gain is below delta.

    The L2 gain is not checked for delta = inf, or if K is not finite.

    critic: the critic, with K
    lost: cost and L2 gain of K
    """
    abscissa = math.inf
    if critic.finite:
        abscissa = spectrum(game.A - game.B @ critic.K).abscissa
    reason = f"A - B K is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
    checks = [below("control_loop_abscissa", abscissa, 0.0, reason, kind="stability")]
    if math.isfinite(game.delta) and critic.finite:
        reason = f"the closed loop has an L2 gain of {lost.gain:.4g}, not below delta"
        checks.append(below("l2_gain", lost.gain, game.delta, reason, kind="gain"))
    return checks


def _value_checks(game: Game, P: np.ndarray, exact: np.ndarray, limit: float) -> list[Check]:
    """Return three checks of a critic's P, on the loop A - S P, the sign of P and the residual.

    A - S P must be stable, P must not be indefinite, and the residual of the Riccati equation must
    be small.

    - If Q is singular, a smallest eigenvalue of P down to -`INDEFINITENESS` is permitted. Rounding
      can make the value of a state without cost negative.
    - If the limit is above `LIMIT`, the smallest eigenvalue of P may be lower than that of P* by
      the change that |P - P*| <= limit |P*| permits (Weyl).

    P: (n, n)
    exact: P*, (n, n)
    limit: limit of the relative residual of the Riccati equation
    """
    form = NormalForm.of(game)
    scaled = form.of_value(P)
    right = form.of_value(exact)
    abscissa = spectrum(game.worst_case_loop(P)).abscissa
    unstable = f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
    residual = float(form.relative_residual(scaled))
    unsolved = f"the residual of the Riccati equation is {residual:.2g}"
    costs = np.linalg.eigvalsh(form.Q)
    least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
    if limit > LIMIT and exact.any():
        allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
        least = min(least, _smallest_eigenvalue(right) - allowed)
    smallest = _smallest_eigenvalue(scaled)
    indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
    return [
        below("game_loop_abscissa", abscissa, 0.0, unstable, kind="game loop"),
        at_least("P_smallest_eigenvalue", smallest, least, indefinite, kind="cost"),
        at_most("riccati_residual", residual, limit, unsolved, kind="error"),
    ]


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Return the smallest eigenvalue of (P + P')/2, relative to the largest entry of |P|.

    The result is 0 for P = 0.
    """
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _flight_section(game: Game, critic: Critic, lost: FlightCost) -> Section:
    """Return a section of the report that compares a critic with the optimum.

    The section lists the cost above the optimum, the L2 gain, the distance to instability and the
    disk margin.

    lost: cost, L2 gain and distance to instability of the critic and the optimum (`_flight_cost`)
    """
    learned = None
    if math.isfinite(lost.gain):
        with suppress(NoSolutionError):
            learned = disk_margin(game, critic.K)
    best = _best_margin(game)
    rows = [
        ("% above the optimum, worst case", f"{lost.worst:.3g}", "0"),
        ("% above the optimum, mean over cases", f"{lost.mean:.3g}", "0"),
        ("L2 gain", f"{lost.gain:.4g}", f"{lost.exact_gain:.4g}"),
        ("distance to instability", f"{lost.distance:.3g}", f"{lost.exact_distance:.3g}"),
        ("margin of all inputs, disk", _margin(learned, "disk"), _margin(best, "disk")),
        ("margin of all inputs, gain", _margin(learned, "gain"), _margin(best, "gain")),
        ("margin of all inputs, phase, deg", _margin(learned, "phase"), _margin(best, "phase")),
    ]
    data = Details(
        graded=lost,
        disk_margin=math.nan if learned is None else learned.disk,
        disk_margin_exact=best.disk,
    )
    table = Table(("linear loop with the worst disturbance", "learned", "exact"), rows)
    return Section((table,), data)


@lru_cache
def _best_margin(game: Game) -> DiskMargin:
    """Return the disk margin of the game's exact gain."""
    return disk_margin(game, unconfirmed_solution(game).K)


def _polynomial_section(critic: Critic) -> Section:
    """Return a section of the report on a network with one layer, whose value is a polynomial.

    The errors of such a network are bounded without a search.
    """
    data = {
        "output": "V",
        "precision": critic.precision,
        "value_at_origin": critic.constant,
        "origin": critic.origin,
    }
    text = f"Polynomial, {critic.precision} weights, V(0) = {critic.constant:.4g}"
    return Section((text,), Details(network=data))


def _margin(margin: DiskMargin | None, name: str) -> str:
    return "-" if margin is None else f"{getattr(margin, name):.4g}"
