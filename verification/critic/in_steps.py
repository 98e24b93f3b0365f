"""Games in discrete time, as a verdict needs them."""

from __future__ import annotations

import math
from functools import partial

import casadi as ca
import numpy as np

from controller.critic.critic import Critic, symbols_for
from controller.discrete.implied_policy import discrete_critic
from controller.discrete.solution import bellman_residual, solve_discrete
from controller.game.discrete_game import DiscreteGame
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY
from controller.riccati.cost import excess_ratios
from controller.riccati.normal_form import NormalForm
from hfa_support.errors import BadInputError
from hfa_support.matrices import checked_matrix, shape_text, spectral_radius
from hfa_support.reporting.checks import Check, at_most, below
from verification.axis import (
    DECAY,
    MOST_STEPS,
    LinearLoop,
    Loop,
    cost_of,
    quadratic_at,
    step_loop,
)
from verification.critic_errors import error_check, relative_error
from verification.scope import NonlinearPlant
from verification.verdict import Details, Section


class InSteps:
    """Game on the plant x⁺ = A x + B u + E w in discrete time, with discount factor α.

    Under the worst disturbance, a policy u has the cost
    J = V* + Σ αᵏ (u - u*)'(R + α B'P*B)(u - u*).

    problem: the game

    Raises NoSolutionError if the game has no certified solution.
    """

    period = "step"

    def __init__(self, problem: DiscreteGame) -> None:
        self.problem = problem
        self.step = problem.step
        self.exact = solve_discrete(problem)
        step = self.step
        self._worst = step.A + step.E @ self.exact.disturbance_gain
        self.price = step.R + problem.discount * step.B.T @ self.exact.P @ step.B

    @property
    def name(self) -> str:
        """Name of the game in the first line of a verdict."""
        return "discrete game" if self.problem.dt is None else "sampled game"

    @property
    def solution(self) -> str:
        """Name of the exact solution in the heading of a report."""
        discount = f"discount {self.problem.discount:g} a step"
        if self.problem.dt is None:
            return f"solution of the game in discrete time, {discount}"
        return f"solution of the discounted game, {discount} of {self.problem.dt:g} s"

    def critic(self, given: Critic) -> Critic:
        """Return the critic with the policy that is optimal for one step, followed by its value."""
        return discrete_critic(self.problem, given)

    def gain(self, P: np.ndarray) -> np.ndarray:
        """Return K (m, n) of the policy that is optimal for one step, followed by x'P x."""
        return self.problem.gain(P)

    def more_errors(self, critic: Critic, box: np.ndarray, limit: float) -> list[Check]:
        """Return the checks of the matrices L and H of a critic, as far as they are given.

        The error of L is relative to |L|. The error of an entry H_ij is relative to √(H_ii H_jj).
        An H over (x, u) is compared with the exact H for the worst w.

        Raises BadInputError if L has a wrong shape.
        """
        checks = []
        if critic.L is not None:
            right = self.exact.disturbance_gain
            L = checked_matrix("L", critic.L, LARGEST_CRITIC_ENTRY)
            if L.shape != right.shape:
                raise BadInputError(
                    f"L is {shape_text(L.shape)}; give {shape_text(right.shape)} for this plant"
                )
            checks.append(error_check("L_rel_error", relative_error(L, right), limit, "L"))
        if critic.H is not None:
            right = self.exact.H
            size = len(critic.H)
            if size < len(right):  # over (x, u), for the worst w
                crossed = right[:size, size:]
                by_worst = crossed @ np.linalg.solve(right[size:, size:], crossed.T)
                right = right[:size, :size] - by_worst
            sizes = np.sqrt(np.abs(np.diag(right)))
            error = float(np.max(np.abs(critic.H - right) / np.outer(sizes, sizes)))
            checks.append(error_check("H_entry_error", error, limit, "an entry of H"))
        return checks

    def linear_loop(self, critic: Critic, is_exact: bool) -> LinearLoop:
        """Return the checks that the spectral radii of A - B K and √α (A - B K) are below 1.

        If √α (A - B K) is unstable, the discounted cost is infinite. The radii are inf if K is not
        finite. L2 gain and margins are not checked.
        """
        step = self.step
        radius = math.inf
        excess = None
        if critic.finite:
            radius = spectral_radius(step.A - step.B @ critic.K)
            excess = self.excess(critic.K)
        discounted_radius = math.sqrt(self.problem.discount) * radius
        unstable = f"A - B K of a step has the spectral radius {radius:.7g}"
        if is_exact:
            unstable += ": the exact solution of this discounted problem does not stabilize either"
        unpaid = f"sqrt(discount) (A - B K) has the spectral radius {discounted_radius:.7g}"
        checks = [
            below("control_loop_radius", radius, 1.0, unstable, kind="stability"),
            below("discounted_loop_radius", discounted_radius, 1.0, unpaid, kind="cost"),
        ]
        lost = math.inf
        if excess is not None:
            worst, _ = excess_ratios(excess, self.exact.P, NormalForm.of(step).units)
            lost = 100.0 * worst
        data = Details(
            discount=self.problem.discount, cost_lost_worst_percent=lost, dt=self.problem.dt
        )
        text = "L2 gain and margins apply only to continuous time and are not checked"
        return LinearLoop(checks, lost, Section((text,), data))

    def value_checks(self, P: np.ndarray, limit: float) -> list[Check]:
        """Return the check of the residual of Bellman's equation.

        P: (n, n)
        limit: limit of the relative residual
        """
        residual = float(self.residuals(P[None])[0])
        reason = f"the residual of Bellman's equation is {residual:.2g}"
        return [at_most("bellman_residual", residual, limit, reason, kind="error")]

    def game_loop(self, P: np.ndarray) -> Check:
        """Return the check that √α (A - B K + E L) of the policies of x'P x is stable."""
        K, L = self.problem.policies((P + P.T) / 2.0)
        loop = self.step.A - self.step.B @ K + self.step.E @ L
        radius = math.inf
        if np.isfinite(loop).all():
            radius = math.sqrt(self.problem.discount) * spectral_radius(loop)
        reason = f"sqrt(discount) (A - B K + E L) has the spectral radius {radius:.7g}"
        return below("game_loop_radius", radius, 1.0, reason, kind="game loop")

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the residuals of Bellman's equation, relative to the largest term, (N,)."""
        residuals = [bellman_residual(self.problem, (P + P.T) / 2.0) for P in values]
        return np.array(residuals)

    def exact_at(self, kind: str, z: ca.SX) -> ca.SX:
        """Return the exact function "value", "gradient" or "policy" at the state z, (n,)."""
        return quadratic_at(self.exact, kind, z)

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether all eigenvalues of A - B K are inside the unit circle."""
        return spectral_radius(self.step.A - self.step.B @ K) < 1.0

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return x'Q x + 2 x'N u + u'R u."""
        both = np.hstack([z, u])
        return float(both @ self.step.weights @ both)

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return X = α F'X F + (K - K*)'(R + α B'P*B)(K - K*) with F = A + E L* - B K.

        The result is None if √α F is not finite or has an eigenvalue outside the open unit disk.
        """
        from scipy.linalg import solve_discrete_lyapunov

        moved = math.sqrt(self.problem.discount) * (self._worst - self.step.B @ K)
        if not np.isfinite(moved).all() or spectral_radius(moved) >= 1.0:
            return None
        change = K - self.exact.K
        return np.asarray(solve_discrete_lyapunov(moved.T, change.T @ self.price @ change))

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """
        return self._loop_of(self.step.A, critic, b)

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under the worst disturbance w = L* x of the exact solution.

        The cost is Σ αᵏ v'(R + α B'P*B) v, with v = u - u* minus its value at the equilibrium.
        """
        return self._loop_of(self._worst, critic, b)

    def _loop_of(self, A: np.ndarray, critic: Critic, b: np.ndarray) -> Loop:
        policy = critic.policy
        x = symbols_for([policy], len(b))
        B = self.step.B
        after = ca.DM(A) @ x + ca.DM(B) @ policy(x)
        slowest = max(self.exact.radius, spectral_radius(A - B @ critic.K), 1e-3)
        decay = -math.log(min(slowest, 1.0 - 1e-12))
        steps = min(math.ceil(DECAY / decay), MOST_STEPS)
        by_exact = A - B @ self.exact.K
        running = partial(cost_of, policy, self.exact.K, self.price)
        return step_loop(x, after, self.exact, by_exact, steps, b, running)

    def plant_loop(self, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray) -> None:
        """Return None: the nonlinear plant is simulated in continuous time alone."""
