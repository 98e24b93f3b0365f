"""A critic of the discounted problem in discrete time against the exact solution of that problem.

x⁺ = A x + B u + E w,  J = Σ γᵏ (x'Qx + u'Ru - δ² w'w) dt, u and w held over each step. The policy of V = x'P x is
u = -(R + γ B'P B - γ² B'P E (γ E'P E - δ² I)⁻¹ E'P B)⁻¹ ..., which `policies_of_step` has in one piece.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.discrete import DiscountedSolution, discounted_checks, policies_of_step, solve_discounted
from hfa_support.errors import BadInputError
from hfa_support.jsonable import finite_or_none
from hfa_support.reporting.checks import Check, Checked, at_most, below, checks_block, verdict_text
from hfa_support.reporting.report import Report, Reported
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import gain_errors, value_errors
from verification.critic.diagnosis import repaired


@dataclass(frozen=True, eq=False, repr=False)
class DiscountedCheck(Checked, Reported):
    """The verdict on a critic of the discounted problem. exact: the certified solution. lost: percent that u = -K x
    costs more than the optimum from the worst start, under the exact w = L x. diagnosis: the mistake recognized, or
    ""."""

    exact: DiscountedSolution
    candidate: Candidate
    checks: tuple[Check, ...]
    lost: float
    dt: float
    diagnosis: str

    def holds(self, limit_cost: float | None = None) -> bool:
        """Whether every check holds, or with a limit, percent, whether the critic costs no more."""
        return self.ok if limit_cost is None else self.lost <= limit_cost

    def report(self, origin: str = "the plant", limit_cost: float | None = None) -> Report:
        """The verdict in the first line, and every check."""
        failed = next((check for check in self.checks if not check.ok), None)
        decided = "the error limit" if limit_cost is None else f"the cost limit {limit_cost:g} percent"
        said = "exact" if failed is None else f"not exact ({failed.reason})"
        stable = next(check.ok for check in self.checks if check.name == "control_loop_radius")
        cost = f"cost lost {self.lost:.2g} percent" if math.isfinite(self.lost) else "cost without bound"
        mistake = f"; most likely: {self.diagnosis}" if self.diagnosis else ""
        loop = "stabilizing" if stable else "not stabilizing"
        problem = f"discount {self.exact.discount:g} a step of {self.dt:g} s"
        return Report(
            f"{verdict_text(self.holds(limit_cost))} by {decided}: {said}, {loop}, {cost}{mistake}",
            (
                f"Critic on {origin}, against the exact solution of the discounted game, {problem}",
                checks_block(self.checks),
                "L2 gain, margins and the box of states belong to continuous time and are not checked",
            ),
            data=self.to_dict(),
        )

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        named = {check.name: check.value for check in self.checks}
        P = self.candidate.P
        return {
            "schema": "hfa.discounted-check/1",
            "ok": self.ok,
            "discount": self.exact.discount,
            "dt": self.dt,
            "P_rel_error": finite_or_none(named.get("P_rel_error", math.nan)),
            "K_rel_error": finite_or_none(named["K_rel_error"]),
            "cost_lost_worst_percent": finite_or_none(self.lost),
            "diagnosis": self.diagnosis,
            "checks": [check.to_dict() for check in self.checks],
            "P": None if P is None else P.tolist(),
            "K": self.candidate.K.tolist(),
            "P_exact": self.exact.P.tolist(),
            "K_exact": self.exact.K.tolist(),
        }


def check_discounted(
    game: Game, candidate: Candidate, discount: float, dt: float, *, limit: float = 1e-6
) -> DiscountedCheck:
    """Compare P and K at the origin with `solve_discounted`; a K that came without P is compared alone.

    A critic of V or dV/dx has the policy of its P, not R⁻¹B'P. NoSolutionError where the problem has no certified
    solution.
    """
    exact = solve_discounted(game, discount, dt)
    step, K, P = exact.game, candidate.K, candidate.P
    if not candidate.finite:
        raise BadInputError("the critic has numbers that are too large or not finite")
    if P is not None and candidate.derived:
        with np.errstate(all="ignore"):
            K = policies_of_step(step, (P + P.T) / 2.0, discount)[0]
    candidate = Candidate(K, P, candidate.functions, candidate.weights)
    root = math.sqrt(discount)
    radius = float(np.abs(np.linalg.eigvals(root * (step.A - step.B @ K))).max()) if np.isfinite(K).all() else math.inf
    errors = (*gain_errors(game, K, exact.K, limit), *(() if P is None else value_errors(game, P, exact.P, limit)))
    checks = [*errors, below("control_loop_radius", radius, 1.0, f"sqrt(discount) (A - B K) has radius {radius:.4g}")]
    if P is not None:
        alike = Game(root * step.A, root * step.B, root * step.E, step.Q, step.R, step.delta)
        residual = discounted_checks(alike, (P + P.T) / 2.0)[0].value
        said = f"Bellman's equation is left with a residual of {residual:.2g}"
        checks.append(at_most("bellman_residual", residual, limit, said))
    diagnosis = ""
    if not all(check.ok for check in errors):
        diagnosis = repaired(game, exact.P, exact.K, candidate)
    return DiscountedCheck(exact, candidate, tuple(checks), _lost(exact, K), dt, diagnosis)


def _lost(exact: DiscountedSolution, K: np.ndarray) -> float:
    """Largest of x'Dx / x'P*x, percent: D = γ F'D F + (K - K*)'(R + γ B'P*B)(K - K*), F = A - B K + E L*."""
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
