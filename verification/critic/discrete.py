"""Comparison of the critic of a discrete-time game with the exact solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from controller.critic.critic import Critic
from controller.discrete.implied_policy import discrete_critic
from controller.discrete.solution import DiscreteSolution, bellman_residual, sampled, solve_discrete
from controller.game.discrete_game import DiscreteGame
from controller.game.weights import weights_line
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.matrices import checked_matrix, shape_text
from hfa_support.reporting.checks import Check, at_most, below
from verification.critic_errors import error_check, matrix_errors, relative_error
from verification.hfa_box import usual_box
from verification.reasons.diagnosis import diagnose_discrete
from verification.scope import LIMIT, Scope
from verification.verdict import Details, Section, Verdict, explained

#: Function (exact solution, critic, half-widths of the box (n,)) -> sentence on the mistake, or "".
Diagnose = Callable[[DiscreteSolution, Critic, np.ndarray], str]


class DiscreteVerdict(Verdict):
    """Verdict on a critic of a discrete-time game."""

    schema = "hfa.discounted-check/1"
    made_by = "hfa verify --discount --dt"


def check_discounted(
    game: Game,
    critic: Critic,
    discount: float,
    dt: float | None = None,
    *,
    limit: float = LIMIT,
    scope: Scope | None = None,
) -> Verdict:
    """Return the verdict on a critic for a sampled and discounted continuous-time game.

      x⁺ = A x + B u + E w,  J = Σ αᵏ (x'Qx + u'Ru - δ² w'w) dt

    A, B and E are the matrices of one sample time with constant u and w. `check_discrete` describes
    the check and its errors.

    discount: α, the factor for one sample time
    dt: sample time, s. None: `game` is in discrete time, and J has no factor dt.
    limit: largest permitted relative error
    scope: extent of the checks of a network, by default `Scope()`

    Raises BadInputError if the discount or dt is out of range.
    """
    if dt is None:
        return check_discrete(DiscreteGame(game, discount), critic, limit=limit, scope=scope)

    def diagnose(exact: DiscreteSolution, critic: Critic, box: np.ndarray) -> str:
        says = "in continuous time, without discount"
        return diagnose_discrete(game, exact, critic, says, {}, box)

    problem = sampled(game, dt, discount)
    verdict = _verdict(problem, critic, limit, scope or Scope(), diagnose)
    section = verdict.sections[0]
    return replace(
        verdict,
        problem=f"solution of the discounted game, discount {discount:g} a step of {dt:g} s",
        sections=(section._replace(data=replace(section.data, dt=dt)), *verdict.sections[1:]),
    )


def check_discrete(
    problem: DiscreteGame,
    critic: Critic,
    *,
    limit: float = LIMIT,
    more: Mapping[str, np.ndarray] | None = None,
    scope: Scope | None = None,
) -> Verdict:
    """Return the verdict on a critic of a discrete-time game, compared with the exact solution.

    The policy of a critic of V or dV/dx is the policy that V implies in discrete time, not R⁻¹B'P.
    The verdict requires that A - B K and √α (A - B K) are stable. If √α (A - B K) is unstable, the
    discounted cost is infinite. An exact critic fails if the exact solution does not stabilize. A
    network, or a value that is not quadratic, is also searched for errors and simulated over a box
    of states. L2 gain and margins are not checked.

    limit: largest permitted relative error
    more: further matrices of the critic: L (k, n) of w = L x, and H of its Q-function over (x, u,
        w) or (x, u)
    scope: extent of the checks of a network, by default `Scope()`

    Raises BadInputError if the limit is not positive, an entry of the critic is not finite, or L
    has a wrong shape. Raises NoSolutionError if the game has no certified solution.
    """
    step = problem.step
    others = {
        "without disturbance (delta = inf)": replace(problem, step=step.with_delta(math.inf)),
        "without discount": replace(problem, discount=1.0),
        "without cross weights N": replace(problem, step=replace(step, N=0.0 * step.N)),
    }

    def diagnose(exact: DiscreteSolution, critic: Critic, box: np.ndarray) -> str:
        question = 'of x\' = A x + B u; did you mean time = "continuous"?'
        return diagnose_discrete(step, exact, critic, question, others, box)

    return _verdict(problem, critic, limit, scope or Scope(), diagnose, more)


def _verdict(
    problem: DiscreteGame,
    critic: Critic,
    limit: float,
    scope: Scope,
    diagnose: Diagnose,
    more: Mapping[str, np.ndarray] | None = None,
) -> Verdict:
    """Return the verdict that `check_discrete` and `check_discounted` report.

    diagnose: function (exact solution, critic, box of states) -> sentence on the mistake, or ""
    more: further matrices L and H of the critic, or None

    Raises the errors of `check_discrete`.
    """
    refuse_unless_positive("limit", limit)
    exact = solve_discrete(problem)
    if not critic.finite:
        raise BadInputError(
            "the critic has entries that are too large or not finite; correct these entries"
        )
    step = problem.step
    box = scope.box or usual_box(step)
    critic = discrete_critic(problem, critic)
    errors = list(matrix_errors(step, "K", critic.K, exact.K, limit))
    if critic.P is not None:
        errors += matrix_errors(step, "P", critic.P, exact.P, limit)
    errors += _errors_of_parts(exact, more or {}, limit)
    checks = [*errors, *_loop_checks(problem, critic.K, all(check.ok for check in errors))]
    if critic.P is not None:
        residual = bellman_residual(problem, (critic.P + critic.P.T) / 2.0)
        reason = f"the residual of Bellman's equation is {residual:.2g}"
        checks.append(at_most("bellman_residual", residual, limit, reason, kind="error"))
    lost = discounted_cost_above_optimum(exact, critic.K)
    text = (
        "L2 gain, margins and the box of states apply only to continuous time and are not checked"
    )
    data = Details(discount=problem.discount, cost_lost_worst_percent=lost)
    sections = [Section((text,), data)]
    states = 0
    proof = None
    if not critic.is_quadratic:
        from verification.axis import InSteps
        from verification.network.search import findings_of

        findings = findings_of(InSteps(exact), critic, exact, box.half_widths, limit, scope)
        errors += findings.errors
        checks += findings.checks
        states = findings.states
        proof = findings.proof
        lost = findings.flown.cost_lost_flown_percent
        where = f"Box of states: {box.about}"
        text = "L2 gain and margins apply only to continuous time and are not checked"
        sections = [Section((where, text), replace(data, box=box)), findings.section]
    diagnosis = ""
    if not all(check.ok for check in errors):
        diagnosis = diagnose(exact, critic, box.half_widths)
    return DiscreteVerdict(
        critic,
        exact,
        explained(checks, diagnosis),
        limit,
        diagnosis,
        lost,
        states,
        proof,
        problem=f"solution of the game in discrete time, discount {problem.discount:g} a step",
        weights=weights_line(problem.step.Q, problem.step.R, problem.step.delta),
        sections=tuple(sections),
    )


def _loop_checks(problem: DiscreteGame, K: np.ndarray, is_exact: bool) -> list[Check]:
    """Return the checks that the spectral radii of A - B K and √α (A - B K) are below 1.

    The radii are inf if K is not finite.

    is_exact: whether the critic equals the exact solution, for the text of the check
    """
    step = problem.step
    radius = math.inf
    if np.isfinite(K).all():
        radius = float(np.abs(np.linalg.eigvals(step.A - step.B @ K)).max())
    discounted_radius = math.sqrt(problem.discount) * radius
    unstable = f"A - B K of a step has the spectral radius {radius:.7g}"
    if is_exact:
        unstable += ": the exact solution of this discounted problem does not stabilize either"
    unpaid = f"sqrt(discount) (A - B K) has the spectral radius {discounted_radius:.7g}"
    return [
        below("control_loop_radius", radius, 1.0, unstable, kind="stability"),
        below("discounted_loop_radius", discounted_radius, 1.0, unpaid, kind="cost"),
    ]


def _errors_of_parts(
    exact: DiscreteSolution, parts: Mapping[str, np.ndarray], limit: float
) -> tuple[Check, ...]:
    """Return the checks of the matrices L and H of a critic, as far as they are given.

    The error of L is relative to |L|. The error of an entry H_ij is relative to √(H_ii H_jj). An H
    over (x, u) is compared with the exact H for the worst w.

    Raises BadInputError if L has a wrong shape.
    """
    checks = []
    if "L" in parts:
        L = checked_matrix("L", parts["L"], LARGEST_CRITIC_ENTRY)
        if L.shape != exact.disturbance_gain.shape:
            shape = shape_text(exact.disturbance_gain.shape)
            raise BadInputError(f"L is {shape_text(L.shape)}; give {shape} for this plant")
        error = relative_error(L, exact.disturbance_gain)
        checks.append(error_check("L_rel_error", error, limit, "L"))
    if "H" in parts:
        H = np.asarray(parts["H"], dtype=float)
        right = exact.H
        size = len(H)
        if size < len(right):  # over (x, u), for the worst w
            crossed = right[:size, size:]
            right = right[:size, :size] - crossed @ np.linalg.solve(right[size:, size:], crossed.T)
        sizes = np.sqrt(np.abs(np.diag(right)))
        error = float(np.max(np.abs(H - right) / np.outer(sizes, sizes)))
        checks.append(error_check("H_entry_error", error, limit, "an entry of H"))
    return tuple(checks)


def discounted_cost_above_optimum(exact: DiscreteSolution, K: np.ndarray) -> float:
    """Return the largest excess of the cost of u = -K x over the optimum, percent.

    The excess from the worst initial state is 100 times the largest x'Dx / x'P*x. D solves

      D = α F'D F + (K - K*)'(R + α B'P*B)(K - K*),  F = A - B K + E L*.

    Return inf if √α F is unstable, or if P* is not positive definite and D is not 0.
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
    except np.linalg.LinAlgError:  # a state without cost
        return math.inf if D.any() else 0.0
