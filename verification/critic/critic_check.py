"""A learned critic against the exact solution of the same game: how far off, and does it do what it
should."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import basis
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game, checked_matrix, shape_text
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import INDEFINITENESS
from controller.riccati.cost import SIGNLESS, FlightCost, flight_cost
from controller.riccati.gare import Solution, solve_game
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.normal_form import relative_residual, relative_residuals
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unless_positive
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.text import Table
from verification.critic.critic_errors import (
    balanced_box,
    critic_errors,
    error_check,
    matrix_errors,
    relative_error,
)
from verification.critic.scope import Scope
from verification.critic.verdict import ErrorTable, Section, Verdict

if TYPE_CHECKING:
    from controller.game.discrete_game import DiscreteGame
    from controller.game.training_run import TrainingRun
    from controller.riccati.discrete import DiscreteSolution

#: Default limit of the errors of P, K, V, its slopes and the policies, and of the Riccati residual.
LIMIT = 1e-6
#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9


def check_critic(
    game: Game,
    critic: Critic,
    *,
    limit: float = LIMIT,
    scope: Scope | None = None,
    run: TrainingRun | None = None,
) -> Verdict:
    """The verdict on a critic, compared with the exact solution of its game.

    It checks the errors of P and K (norms and entries), of V, its slopes and both policies over a
    box of states, stability of A - B K and A - S P, P > 0, the Riccati residual, and an L2 gain
    below delta. The box of a network is searched, a bound is proved where it can be, and it is
    flown from there.

    game: that it should solve
    critic: what is judged
    limit: of the errors and the residual
    scope: on what else it is judged
    run: the training run that the critic is the end of: the rank of its data is checked, and the
        time when it settles where it promises one.

    NoSolutionError when the game itself has no certified solution to compare with.

    >>> import hfa
    >>> game = hfa.paper.published_game(hfa.paper.level_model(hfa.aircraft(), 0.2))
    >>> K = hfa.solve_game(game).K
    >>> hfa.check_critic(game, hfa.from_gain(game, 1.01 * K)).diagnosis
    'every entry of K is 1.01 times the exact one'
    """
    refuse_unless_positive("limit", limit)
    if not isinstance(critic, Critic):
        raise BadInputError(
            f"the critic is a {type(critic).__name__}; make a critic of it with from_gain(game, K),"
            " from_value(game, P), from_weights(game, W) or from_network"
        )
    scope = scope or Scope()
    exact = solve_game(game)
    box = scope.box or balanced_box(game)
    lost = _flight_cost(game, exact, critic.K)
    errors = list(critic_errors(game, critic, exact, limit, box))
    loops = _loop_checks(game, critic, lost)
    checks = [*errors, *loops]
    if critic.P is not None and critic.finite:
        checks += _value_checks(game, critic.P, exact.P, limit)
    cost_lost = lost.worst
    states = 0
    proof = None
    sections = [_flight_section(game, critic, exact, lost)]
    if critic.network:
        from verification.critic.network_search import STARTS, findings

        network = findings(game, critic, exact, box.half_widths, limit, scope)
        errors += network.errors
        checks += network.checks
        states = STARTS
        proof = network.proof
        cost_lost = max(cost_lost, network.flown.cost_lost_flown_percent)
        sections.append(network.section)
    elif critic.origin.startswith("network"):
        sections.append(_polynomial_section(critic))
    diagnosis = ""
    table = None
    if run is not None:
        table = _run_table(game, run, exact)
        run_checks = _run_checks(run, table)
        checks += run_checks
        diagnosis = run_checks[0].reason
    if not diagnosis and critic.finite and not all(check.ok for check in errors):
        from verification.critic.diagnosis import diagnose

        with suppress(NoSolutionError):  # of another game, with which it would be compared
            diagnosis = diagnose(game, exact, critic, limit, scope.nearby, box.half_widths)
    return Verdict(
        critic,
        exact,
        _explained(checks, diagnosis),
        limit,
        diagnosis,
        cost_lost,
        states,
        proof,
        sections=(Section((f"Box of states: {box.about}",), {"box": box.to_dict()}), *sections),
        table=table,
    )


def check_history(
    game: Game,
    critics: Sequence[Critic],
    *,
    limit: float = LIMIT,
    scope: Scope | None = None,
    predefined_time: float | None = None,
    progress: Progress | None = None,
) -> Verdict:
    """The verdict on the last critic of a history (`check_critic`), with a table of the errors of
    all its critics over time.

    game: the game that they should solve.
    critics: in order of their `time`, as `critics_in` and `critics_over_time` make them.
    limit: of every error and of the residual.
    scope: on what else the last critic is judged.
    predefined_time: T_w, s; a check is added that from then on every error stays within the limit.
        None: no such check.
    progress: called with the critics done and their number.

    BadInputError when the critics have no times.
    """
    if not critics or any(critic.time is None for critic in critics):
        raise BadInputError("a history needs critics with times; make them by critics_over_time")
    verdict = check_critic(game, critics[-1], limit=limit, scope=scope)
    box = scope.box if scope is not None else None
    rows = []
    for critic in told(critics, progress):
        errors = {
            check.name: check.value
            for check in critic_errors(game, critic, verdict.exact, limit, box)
        }
        row = {
            "P_rel_error": errors.get("P_rel_error", math.nan),
            "K_rel_error": errors["K_rel_error"],
            "riccati_residual": math.nan if critic.P is None else _residual(game, critic.P),
            "largest_error": max(errors.values()),
        }
        rows.append(row)
    times = np.array([critic.time for critic in critics], dtype=float)
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    table = ErrorTable(times, columns, "largest_error", limit, predefined_time)
    checks = verdict.checks
    if predefined_time is not None:
        reason = f"{table.sentence}; T_w is {predefined_time:g} s"
        settling = table.settling_time
        check = at_most("settling_time", settling, predefined_time, reason, kind="data")
        checks = (*checks, check)
    sections = (*verdict.sections, table.section())
    return replace(verdict, checks=checks, sections=sections, table=table)


def check_discounted(
    game: Game, critic: Critic, discount: float, dt: float | None = None, *, limit: float = LIMIT
) -> Verdict:
    """`check_discrete` on a game in continuous time, sampled with u and w held over each step.

    x⁺ = A x + B u + E w,  J = Σ γᵏ (x'Qx + u'Ru - δ² w'w) dt. Without dt (s) the game is one of a
    step already.
    """
    from controller.game.discrete_game import DiscreteGame
    from controller.riccati.discrete import sampled

    if dt is None:
        return check_discrete(DiscreteGame(game, discount), critic, limit=limit)
    verdict = _check_of_matrices(DiscreteGame(sampled(game, dt), discount), critic, limit)
    section = verdict.sections[0]
    verdict = replace(
        verdict,
        problem=f"solution of the discounted game, discount {discount:g} a step of {dt:g} s",
        sections=(section._replace(data=section.data | {"dt": dt}),),
    )
    return _with_diagnosis(verdict, game, "in continuous time, without discount", {})


def check_discrete(
    problem: DiscreteGame,
    critic: Critic,
    *,
    limit: float = LIMIT,
    more: Mapping[str, np.ndarray] | None = None,
) -> Verdict:
    """The verdict on a critic of a game in discrete time, compared with the exact solution.

    A critic of V or dV/dx has the policy that its P implies there, not R⁻¹B'P; a K that came
    without P is compared alone. Both √α (A - B K), on which the discounted cost depends, and A - B
    K itself must be stable: the exact solution of a discounted problem need not stabilize, and then
    the verdict is that it is exact, does not stabilize and fails.

    more: of the critic too: L (k, n) of w = L x, H of its Q-function over (x, u, w) or (x, u)

    L2 gain, margins and the box of states belong to continuous time and are not checked.
    NoSolutionError where the problem has no certified solution.
    """
    step = problem.step
    others = {
        "without disturbance (delta = inf)": replace(problem, step=step.with_delta(math.inf)),
        "without discount": replace(problem, discount=1.0),
        "without cross weights N": replace(problem, N=None),
    }
    verdict = _check_of_matrices(problem, critic, limit, more)
    question = 'of x\' = A x + B u; did you mean time = "continuous"?'
    return _with_diagnosis(verdict, step, question, others)


def discrete_critic(problem: DiscreteGame, critic: Critic) -> Critic:
    """The critic with the policy that its P implies in discrete time; with its own where it has
    one."""
    if critic.P is None or critic.feedback is None:
        return critic
    with np.errstate(all="ignore"):
        K = problem.policies((critic.P + critic.P.T) / 2.0)[0]
    return replace(critic, K=K, feedback=None)


def _with_diagnosis(
    verdict: Verdict, game: Game, continuous: str, others: Mapping[str, DiscreteGame]
) -> Verdict:
    """The verdict; where an error is too large, with the mistake that `diagnose_discrete` names."""
    from verification.critic.diagnosis import diagnose_discrete

    if all(check.ok for check in verdict.checks if check.name.endswith("_error")):
        return verdict
    diagnosis = diagnose_discrete(game, verdict.exact, verdict.critic, continuous, others)
    return replace(verdict, checks=_explained(verdict.checks, diagnosis), diagnosis=diagnosis)


def _check_of_matrices(
    problem: DiscreteGame,
    critic: Critic,
    limit: float,
    more: Mapping[str, np.ndarray] | None = None,
) -> Verdict:
    """`check_discrete` without a diagnosis."""
    from controller.riccati.discrete import bellman_residual, solve_discrete

    exact = solve_discrete(problem)
    if not critic.finite:
        raise BadInputError("the critic has numbers that are too large or not finite")
    step = problem.step
    P = None if critic.P is None else (critic.P + critic.P.T) / 2.0
    critic = discrete_critic(problem, critic)
    K = critic.K
    radius = math.inf
    if np.isfinite(K).all():
        radius = float(np.abs(np.linalg.eigvals(step.A - step.B @ K)).max())
    discounted_radius = math.sqrt(problem.discount) * radius
    errors = matrix_errors(step, "K", K, exact.K, limit)
    if P is not None and critic.P is not None:
        errors += matrix_errors(step, "P", critic.P, exact.P, limit)
    errors += _errors_of_parts(exact, more or {}, limit)
    unstable = f"A - B K of a step has the spectral radius {radius:.7g}"
    if all(check.ok for check in errors):
        unstable += ": the exact solution of this discounted problem does not stabilize either"
    unpaid = f"sqrt(discount) (A - B K) has the spectral radius {discounted_radius:.7g}"
    checks = [
        *errors,
        below("control_loop_radius", radius, 1.0, unstable, kind="stability"),
        below("discounted_loop_radius", discounted_radius, 1.0, unpaid, kind="cost"),
    ]
    if P is not None:
        residual = bellman_residual(problem, P)
        reason = f"Bellman's equation is left with a residual of {residual:.2g}"
        checks.append(at_most("bellman_residual", residual, limit, reason, kind="error"))
    lost = _discounted_cost_lost(exact, K)
    text = "L2 gain, margins and the box of states belong to continuous time and are not checked"
    data = {"discount": problem.discount, "cost_lost_worst_percent": lost}
    return Verdict(
        critic,
        exact,
        tuple(checks),
        limit,
        "",
        lost,
        problem=f"solution of the game in discrete time, discount {problem.discount:g} a step",
        schema="hfa.discounted-check/1",
        sections=(Section((text,), data),),
    )


def _errors_of_parts(
    exact: DiscreteSolution, parts: Mapping[str, np.ndarray], limit: float
) -> tuple[Check, ...]:
    """The errors of L, relative to |L|, and of the entries of H, relative to √(H_ii H_jj)."""
    checks = []
    if "L" in parts:
        L = checked_matrix("L", parts["L"], LARGEST_CRITIC_ENTRY)
        if L.shape != exact.disturbance_gain.shape:
            shape = shape_text(exact.disturbance_gain.shape)
            raise BadInputError(f"L is {shape_text(L.shape)}; on this plant it must be {shape}")
        error = relative_error(L, exact.disturbance_gain)
        checks.append(error_check("L_rel_error", error, limit, "L"))
    if "H" in parts:
        H = np.asarray(parts["H"], dtype=float)
        right = exact.H
        size = len(H)
        if size < len(right):  # over (x, u): w is the worst one
            crossed = right[:size, size:]
            right = right[:size, :size] - crossed @ np.linalg.solve(right[size:, size:], crossed.T)
        sizes = np.sqrt(np.abs(np.diag(right)))
        error = float(np.max(np.abs(H - right) / np.outer(sizes, sizes)))
        checks.append(error_check("H_entry_error", error, limit, "an entry of H"))
    return tuple(checks)


def _discounted_cost_lost(exact: DiscreteSolution, K: np.ndarray) -> float:
    """Percent that u = -K x costs more than the optimum from the worst start, under the exact w = L
    x.

    Largest of x'Dx / x'P*x: D = γ F'D F + (K - K*)'(R + γ B'P*B)(K - K*), F = A - B K + E L*.
    """
    from scipy.linalg import eigh, solve_discrete_lyapunov

    step = exact.game
    away = K - exact.K
    F = math.sqrt(exact.discount) * (step.A - step.B @ K + step.E @ exact.disturbance_gain)
    if not np.isfinite(F).all() or np.abs(np.linalg.eigvals(F)).max() >= 1.0:
        return math.inf
    price = step.R + exact.discount * step.B.T @ exact.P @ step.B
    D = solve_discrete_lyapunov(F.T, away.T @ price @ away)
    try:
        return max(100.0 * float(eigh((D + D.T) / 2.0, exact.P, eigvals_only=True)[-1]), 0.0)
    except np.linalg.LinAlgError:  # a state that costs nothing
        return math.inf if D.any() else 0.0


def _flight_cost(game: Game, exact: Solution, K: np.ndarray) -> FlightCost:
    """What K costs; without bound where rounding hides whether its loop is stable."""
    try:
        return flight_cost(game, exact, K)
    except NoSolutionError:
        return flight_cost(game, exact, np.full_like(K, math.inf))


def _loop_checks(game: Game, critic: Critic, lost: FlightCost) -> list[Check]:
    """Whether A - B K is stable, and its L2 gain below delta."""
    abscissa = math.inf
    if critic.finite:
        abscissa = spectrum(game.A - game.B @ critic.K).abscissa
    reason = f"A - B K is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
    checks = [below("control_loop_abscissa", abscissa, 0.0, reason, kind="stability")]
    if math.isfinite(game.delta) and critic.finite:
        reason = f"the closed loop has an L2 gain of {lost.gain:.4g}, not below delta"
        checks.append(below("l2_gain", lost.gain, game.delta, reason, kind="gain"))
    return checks


def _residual(game: Game, P: np.ndarray) -> float:
    """The relative Riccati residual of P in balanced units."""
    units = balanced_units(game)
    return relative_residual(in_units(game, units), P * np.outer(units, units))


def _value_checks(game: Game, P: np.ndarray, exact: np.ndarray, limit: float) -> list[Check]:
    """Whether P is a value: stabilizing, not indefinite, a root of the Riccati equation.

    The value of a state that costs nothing may be 0, which rounding makes negative; the certificate
    allows the same. A limit above the default allows |P - P*| <= limit |P*|, which moves
    eigenvalues by no more (Weyl).
    """
    units = balanced_units(game)
    squared = np.outer(units, units)
    balanced = in_units(game, units)
    scaled = P * squared
    right = exact * squared
    abscissa = spectrum(game.A - game.S @ P).abscissa
    unstable = f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
    residual = relative_residual(balanced, scaled)
    unsolved = f"the Riccati equation is left with a residual of {residual:.2g}"
    costs = np.linalg.eigvalsh(balanced.Q)
    least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
    if limit > LIMIT and exact.any():
        allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
        least = min(least, _smallest_eigenvalue(right) - allowed)
    smallest = _smallest_eigenvalue(scaled)
    indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
    return [
        below("game_loop_abscissa", abscissa, 0.0, unstable, kind="stability"),
        at_least("P_smallest_eigenvalue", smallest, least, indefinite, kind="cost"),
        at_most("riccati_residual", residual, limit, unsolved, kind="error"),
    ]


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Of (P + P')/2, as a part of the largest entry."""
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _explained(checks: Sequence[Check], diagnosis: str) -> tuple[Check, ...]:
    """The checks; the first that failed carries the diagnosis, where a reader looks first."""
    explained = list(checks)
    for index, check in enumerate(checks):
        if not check.ok:
            if diagnosis not in check.reason:
                explained[index] = check._replace(reason=f"{check.reason}: {diagnosis}")
            break
    return tuple(explained)


def _run_table(game: Game, run: TrainingRun, exact: Solution) -> ErrorTable:
    """The errors of P(t) of a training run, computed anew from its weights."""
    psi = basis(run.basis, len(game.A))
    values = np.array([psi.matrix(weights) for weights in run.weights])
    units = balanced_units(game)
    balanced = in_units(game, units)
    residuals = relative_residuals(
        balanced.A,
        balanced.S_control,
        balanced.S_disturbance / balanced.delta**2,
        balanced.Q,
        values * np.outer(units, units),
    )
    errors = {
        "riccati_residual": residuals,
        "P_rel_error": np.array([relative_error(P, exact.P) for P in values]),
    }
    promised = run.settings.get("predefined_time")
    return ErrorTable(run.times, errors, "riccati_residual", SETTLED, promised)


def _run_checks(run: TrainingRun, table: ErrorTable) -> list[Check]:
    """Whether the data determine the weights, and the settling time of a run that promises one."""
    rank = run.excitation
    poor = (
        f"the data have rank {rank.rank} of {rank.size}: whatever their residual, they do not "
        "determine the weights"
    )
    checks = [at_least("data_rank", rank.rank, rank.size, poor, kind="data")]
    promised = table.predefined_time
    if promised is not None:
        reason = f"{table.sentence}; T_w is {promised:g} s"
        settled = table.settling_time
        checks.append(at_most("settling_time", settled, promised, reason, kind="data"))
    return checks


def _flight_section(game: Game, critic: Critic, exact: Solution, lost: FlightCost) -> Section:
    """What the critic costs in closed loop, and its margins, beside the exact ones."""
    learned = None
    if math.isfinite(lost.gain):
        with suppress(NoSolutionError):
            learned = disk_margin(game, critic.K)
    best = disk_margin(game, exact.K)
    rows = [
        ("cost lost, worst start, percent", f"{lost.worst:.3g}", "0"),
        ("cost lost, mean over starts, percent", f"{lost.mean:.3g}", "0"),
        ("L2 gain", f"{lost.gain:.4g}", f"{lost.exact_gain:.4g}"),
        ("distance to instability", f"{lost.distance:.3g}", f"{lost.exact_distance:.3g}"),
        ("margin of all inputs, disk", _margin(learned, "disk"), _margin(best, "disk")),
        ("margin of all inputs, gain", _margin(learned, "gain"), _margin(best, "gain")),
        ("margin of all inputs, phase, deg", _margin(learned, "phase"), _margin(best, "phase")),
    ]
    data = {
        "graded": lost.to_dict(),
        "disk_margin": None if learned is None else learned.disk,
        "disk_margin_exact": best.disk,
    }
    table = Table(("in flight, under the worst disturbance", "learned", "exact"), rows)
    return Section((table,), data)


def _polynomial_section(critic: Critic) -> Section:
    """A network that is a polynomial, whose errors are bounded."""
    data = {
        "output": "V",
        "precision": critic.precision,
        "value_at_origin": critic.constant,
        "origin": critic.origin,
    }
    text = f"Polynomial, {critic.precision} weights, V(0) = {critic.constant:.4g}"
    return Section((text,), {"network": data})


def _margin(margin: DiskMargin | None, name: str) -> str:
    return "-" if margin is None else f"{getattr(margin, name):.4g}"
