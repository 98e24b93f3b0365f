"""A learned critic against the exact solution of the same game: how far off, and does it do what it
should."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import Basis, basis
from controller.game.learning_result import LearningResult, settled_at
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import INDEFINITENESS
from controller.riccati.cost import SIGNLESS, flight_cost
from controller.riccati.gare import Solution, solve_game
from controller.riccati.margins import disk_margin
from controller.riccati.normal_form import relative_residual
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, at_least, at_most, below
from verification.critic.check_result import HISTORY, CriticCheck, HistoryErrors
from verification.critic.critic_errors import Box, critic_errors, matrix_errors, ordinary_box

if TYPE_CHECKING:
    from controller.riccati.discrete import DiscountedSolution

#: Default limit of the errors of P, K, V, its slopes and the policies, and of the Riccati residual.
LIMIT = 1e-6
#: From how many starts a network is flown.
FLIGHTS = 100
#: Relative Riccati residual, in balanced units, below which a run counts as settled.
SETTLED = 1e-9


def check_critic(
    game: Game,
    candidate: Critic,
    *,
    limit: float = LIMIT,
    box: Box | None = None,
    run: LearningResult | None = None,
    predefined_time: float | None = None,
    at_dihedral: Callable[[float], Game] | None = None,
    flights: int = FLIGHTS,
    plant: ca.Function | None = None,
) -> CriticCheck:
    """Compare a critic with the exact solution of its game.

    Checked: errors of P and K (norms and entries), of V, its slopes and both policies over a box of
    states, stability of A - B K and A - S P, P > 0, Riccati residual, L2 gain below
    delta; for a run also the rank of its data, which is taken from it, and its `settling_time`
    against T_w. limit: of the errors and the residual. box: default `ordinary_box`. at_dihedral:
    degrees -> the game there, to recognize a critic of another angle. Of a network the box is
    searched, and it is flown from there `flights` times, also on a nonlinear plant (z, u) -> z'.
    Raises NoSolutionError when the game itself has no certified solution to compare with.
    """
    exact, box = solve_game(game), box or ordinary_box(game)
    refuse_unless_positive("limit", limit)
    flight, K, P, finite = (
        flight_cost(game, exact, candidate.K),
        candidate.K,
        candidate.P,
        candidate.finite,
    )
    abscissa = spectrum(game.A - game.B @ K).abscissa if finite else math.inf
    errors = critic_errors(game, candidate, exact, limit, box)
    searched, network = list[Check](), None
    if candidate.network or candidate.origin.startswith("network"):
        from verification.critic.network_check import network_checks

        flown = flights if abscissa < 0.0 else 0
        searched, network = network_checks(
            game, candidate, exact, box.half_widths, limit, flown, plant
        )
    checks = [
        *errors,
        below(
            "control_loop_abscissa",
            abscissa,
            0.0,
            f"A - B K is not Hurwitz (abscissa {abscissa:+.3g} 1/s)",
        ),
        *(_value_checks(game, P, exact.P, limit) if P is not None and finite else ()),
    ]
    if math.isfinite(game.delta) and finite:
        said = f"the closed loop has an L2 gain of {flight.gain:.4g}, not below delta"
        checks.append(below("l2_gain", flight.gain, game.delta, said))
    diagnosis = ""
    if run is not None:
        run_checks = _run_checks(game, run, predefined_time)
        checks, diagnosis = [*checks, *run_checks], run_checks[0].reason
    checks += searched
    if not diagnosis and finite and not all(check.ok for check in (*errors, *searched)):
        from verification.critic.diagnosis import diagnose

        diagnosis = diagnose(game, exact, candidate, limit, at_dihedral, box.half_widths)
    return CriticCheck(
        exact=exact,
        candidate=candidate,
        checks=tuple(_explained(checks, diagnosis)),
        diagnosis=diagnosis,
        lost=max(flight.worst, 0.0 if network is None else network.cost_lost_flown_percent),
        learned_margin=disk_margin(game, K) if abscissa < 0.0 else None,
        exact_margin=disk_margin(game, exact.K),
        flight=flight,
        box=box,
        network=network,
        run=run,
        predefined_time=predefined_time,
    )


def check_history(
    game: Game,
    history: Sequence[Critic],
    *,
    limit: float = LIMIT,
    box: Box | None = None,
    predefined_time: float | None = None,
    progress: Progress | None = None,
    at_dihedral: Callable[[float], Game] | None = None,
) -> CriticCheck:
    """`check_critic` of the last row of a history, and the errors of every row; somebody's own
    W(t), P(t) or K(t).

    predefined_time: T_w, s, by which every error must be within the limit for good; None: no such
    check. progress: rows done, rows. BadInputError when a row does not fit the game."""
    units = balanced_units(game)
    check = check_critic(game, history[-1], limit=limit, box=box, at_dihedral=at_dihedral)
    assert isinstance(check.exact, Solution)
    balanced, squared, rows = in_units(game, units), np.outer(units, units), []
    for candidate in told(history, progress):
        errors = {
            each.name: each.value
            for each in critic_errors(game, candidate, check.exact, limit, check.box)
        }
        residual = (
            math.nan if candidate.P is None else relative_residual(balanced, candidate.P * squared)
        )
        rows.append(
            (
                errors.get("P_rel_error", math.nan),
                errors["K_rel_error"],
                residual,
                max(errors.values()),
            )
        )
    times = np.array([critic.time for critic in history], dtype=float)
    columns = dict(zip(HISTORY, np.array(rows).T, strict=True))
    found, checks = HistoryErrors(times, columns, limit, predefined_time), check.checks
    if predefined_time is not None:
        late = f"{found.said}; T_w is {predefined_time:g} s"
        checks = (*checks, at_most("settling_time", found.settling_time, predefined_time, late))
    return replace(check, checks=checks, history=found, predefined_time=predefined_time)


def check_discounted(
    game: Game, candidate: Critic, discount: float, dt: float, *, limit: float = LIMIT
) -> CriticCheck:
    """A critic of the discounted problem in discrete time against the exact solution of that
    problem.

    x⁺ = A x + B u + E w,  J = Σ γᵏ (x'Qx + u'Ru - δ² w'w) dt, u and w held over each step. A critic
    of V or dV/dx has the policy that `policies_of_step` makes of its P, not R⁻¹B'P; a K that came
    without P is compared alone. L2 gain, margins and the box of states belong to continuous time
    and are not checked. NoSolutionError where the problem has no certified solution."""
    from controller.riccati.discrete import discounted_checks, policies_of_step, solve_discounted
    from verification.critic.diagnosis import repaired

    exact = solve_discounted(game, discount, dt)
    step, K, P, root = exact.game, candidate.K, candidate.P, math.sqrt(discount)
    if not candidate.finite:
        raise BadInputError("the critic has numbers that are too large or not finite")
    if P is not None and candidate.feedback is not None:
        with np.errstate(all="ignore"):
            K = policies_of_step(step, (P + P.T) / 2.0, discount)[0]
    candidate = replace(candidate, K=K, feedback=None, network={})
    radius = (
        float(np.abs(np.linalg.eigvals(root * (step.A - step.B @ K))).max())
        if np.isfinite(K).all()
        else math.inf
    )
    errors = matrix_errors(game, "K", K, exact.K, limit)
    errors += () if P is None else matrix_errors(game, "P", P, exact.P, limit)
    checks = [
        *errors,
        below(
            "control_loop_radius", radius, 1.0, f"sqrt(discount) (A - B K) has radius {radius:.4g}"
        ),
    ]
    if P is not None:
        alike = Game(root * step.A, root * step.B, root * step.E, step.Q, step.R, step.delta)
        residual = discounted_checks(alike, (P + P.T) / 2.0)[0].value
        said = f"Bellman's equation is left with a residual of {residual:.2g}"
        checks.append(at_most("bellman_residual", residual, limit, said))
    diagnosis = (
        "" if all(check.ok for check in errors) else repaired(game, exact.P, exact.K, candidate)
    )
    return CriticCheck(
        exact,
        candidate,
        tuple(_explained(checks, diagnosis)),
        diagnosis,
        _lost(exact, K),
        discount=exact.discount,
        dt=dt,
    )


def _lost(exact: DiscountedSolution, K: np.ndarray) -> float:
    """Percent that u = -K x costs more than the optimum from the worst start, under the exact w = L
    x.

    Largest of x'Dx / x'P*x: D = γ F'D F + (K - K*)'(R + γ B'P*B)(K - K*), F = A - B K + E L*."""
    from scipy.linalg import eigh, solve_discrete_lyapunov

    step, away = exact.game, K - exact.K
    F = math.sqrt(exact.discount) * (step.A - step.B @ K + step.E @ exact.disturbance_gain)
    if not np.isfinite(F).all() or np.abs(np.linalg.eigvals(F)).max() >= 1.0:
        return math.inf
    price = step.R + exact.discount * step.B.T @ exact.P @ step.B
    D = solve_discrete_lyapunov(F.T, away.T @ price @ away)
    try:
        return max(100.0 * float(eigh((D + D.T) / 2.0, exact.P, eigvals_only=True)[-1]), 0.0)
    except np.linalg.LinAlgError:  # a state that costs nothing
        return math.inf if D.any() else 0.0


def _value_checks(game: Game, P: np.ndarray, exact: np.ndarray, limit: float) -> list[Check]:
    """Whether P is a value: stabilizing, not indefinite, a root of the Riccati equation.

    The value of a state that costs nothing may be 0, which rounding makes negative; the certificate
    allows the same. A limit above the default allows |P - P*| <= limit |P*|, which moves
    eigenvalues by no more (Weyl)."""
    units = balanced_units(game)
    squared, balanced = np.outer(units, units), in_units(game, units)
    scaled, right, costs = P * squared, exact * squared, np.linalg.eigvalsh(balanced.Q)
    residual, abscissa = relative_residual(balanced, scaled), spectrum(game.A - game.S @ P).abscissa
    smallest = _smallest_eigenvalue(scaled)
    least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
    if limit > LIMIT and exact.any():
        allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
        least = min(least, _smallest_eigenvalue(right) - allowed)
    indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
    checks = [
        below(
            "game_loop_abscissa",
            abscissa,
            0.0,
            f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)",
        ),
        at_least("P_smallest_eigenvalue", smallest, least, indefinite),
        at_most(
            "riccati_residual",
            residual,
            limit,
            f"the Riccati equation is left with a residual of {residual:.2g}",
        ),
    ]
    return checks


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Of (P + P')/2, as a part of the largest entry."""
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _explained(checks: list[Check], diagnosis: str) -> Iterator[Check]:
    """The first failed check carries the diagnosis, so that the reason is where a reader looks
    first."""
    first = next((check for check in checks if not check.ok), None)
    for check in checks:
        new = check is first and diagnosis not in check.reason
        yield check._replace(reason=f"{check.reason}: {diagnosis}") if new else check


def _run_checks(
    game: Game, run: LearningResult, predefined_time: float | None
) -> tuple[Check, ...]:
    """The richness of the data, as the run says it; the settling time only of a law that promises
    one."""
    rank = run.excitation
    poor = f"the data have rank {rank.rank} of {rank.size}: whatever their residual, they do not determine the weights"
    rich = at_least("data_rank", rank.rank, rank.size, poor)
    if predefined_time is None:
        return (rich,)
    settled = settling_time(game, run, basis(run.basis, len(game.A)))
    late = (
        f"the residual settles at {settled:.4g} s"
        if math.isfinite(settled)
        else "the residual does not settle"
    )
    return (
        rich,
        at_most(
            "settling_time",
            settled,
            predefined_time,
            f"{late}, not within T_w = {predefined_time:g} s",
        ),
    )


def settling_time(game: Game, run: LearningResult, functions: Basis) -> float:
    """First time from which the Riccati residual of the run's P(t) stays within `SETTLED`, s; inf
    when it does not.

    Computed from the recorded weights, with `certificate.relative_residual` in balanced units:
    whatever the law measures is not asked."""
    units = balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    residuals = np.array(
        [
            relative_residual(balanced, functions.matrix(weights) * squared)
            for weights in run.weights
        ]
    )
    return settled_at(run.times, residuals, SETTLED)
