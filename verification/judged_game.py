"""A game with its exact solution, as a verdict on a critic needs it."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.critic.symbols import symbols_for
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game
from controller.riccati.balancing import loop_check, stability
from controller.riccati.certificate import form_of
from controller.riccati.cost import SIGNLESS, FlightCost, flight_cost, loss_matrix
from controller.riccati.form import INDEFINITENESS
from controller.riccati.gare import unconfirmed_solution
from controller.riccati.margins import DiskMargin, disk_margin
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import checked_matrix, shape_text
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.results import without_empty
from hfa_support.reporting.text import Table
from verification.axis import (
    DECAY,
    SLOWEST,
    STEPS,
    Expression,
    Loop,
    excess_cost_rate,
    flow_loop,
    step_loop,
)
from verification.critic_errors import disturbance_errors, error_check, relative_error
from verification.scope import LIMIT, NonlinearPlant
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


class JudgedGame:
    """Game with its exact solution.

    A policy u has the cost J = V* + ∫ (u - u*)' price (u - u*) - δ² (d - d*)'(d - d*) dt, or the
    sum over the steps. The worst disturbance of u = -K z is d = d* + δ⁻² E'X z in continuous time.
    In discrete time, costs are those under d*.

    game: the game

    Raises NoSolutionError if the game has no certified solution.
    """

    def __init__(self, game: Game) -> None:
        self.game = game
        self.exact = unconfirmed_solution(game)
        self.period = "step" if game.is_discrete else "second"
        self._form = form_of(game)
        self._stability = partial(stability, is_discrete=game.is_discrete)
        self._loop_check = partial(loop_check, is_discrete=game.is_discrete)

    @property
    def name(self) -> str:
        """The game in the first line of a verdict, such as "linear game"."""
        if not self.game.is_discrete:
            return "linear game"
        return "discrete game" if self.game.dt is True else "sampled game"

    @property
    def solution(self) -> str:
        """What `exact` is, for the heading of a report."""
        if not self.game.is_discrete:
            return "game solution"
        discount = f"discount {self.game.discount:g} a step"
        if self.game.dt is True:
            return f"solution of the game in discrete time, {discount}"
        return f"solution of the discounted game, {discount} of {self.game.dt:g} s"

    def more_errors(self, critic: Critic, box: np.ndarray, limit: float) -> list[Check]:
        """Return the checks of errors besides those of K, P, V and u.

        In continuous time, the worst disturbance in the box is compared, if there is a disturbance.
        In discrete time, the matrices L and H of a critic are compared, as far as they are given.
        The error of L is relative to |L|. The error of an entry H_ij is relative to √(H_ii H_jj).
        An H over (x, u) is compared with the exact H for the worst w.

        box: half-widths of the box of states, (n,)

        Raises BadInputError if L has a wrong shape.
        """
        if not self.game.is_discrete:
            return disturbance_errors(self.game, critic, self.exact, box, limit)
        checks = []
        if critic.L is not None:
            exact_L = self.exact.disturbance_gain
            L = checked_matrix("L", critic.L, LARGEST_CRITIC_ENTRY)
            if L.shape != exact_L.shape:
                raise BadInputError(
                    f"L is {shape_text(L.shape)}; give {shape_text(exact_L.shape)} for this plant"
                )
            checks.append(error_check("L_rel_error", relative_error(L, exact_L), limit, "L"))
        if critic.H is not None:
            exact_H = self.exact.H
            assert exact_H is not None  # in discrete time
            size = len(critic.H)
            if size < len(exact_H):  # over (x, u), for the worst w
                crossed = exact_H[:size, size:]
                by_worst = crossed @ np.linalg.solve(exact_H[size:, size:], crossed.T)
                exact_H = exact_H[:size, :size] - by_worst
            sizes = np.sqrt(np.abs(np.diag(exact_H)))
            error = float(np.max(np.abs(critic.H - exact_H) / np.outer(sizes, sizes)))
            checks.append(error_check("H_entry_error", error, limit, "an entry of H"))
        return checks

    def linear_loop(self, critic: Critic, is_exact: bool) -> LinearLoop:
        """Return the verdict on the loop u = -K z.

        A - B K must be stable, and its L2 gain must be below delta, unless delta is inf or K is not
        finite. In discrete time, √α (A - B K) must be stable too, otherwise the cost is infinite.

        is_exact: whether the critic equals the exact solution, for the texts
        """
        K = critic.K
        checks = self._stability_checks(K, is_exact)
        try:
            cost = flight_cost(self.exact, K)
        except NoSolutionError:  # rounding hides whether A - B K is stable
            cost = flight_cost(self.exact, np.full_like(K, math.inf))
        if math.isfinite(self.game.delta) and critic.is_finite:
            reason = f"the closed loop has an L2 gain of {cost.gain:.4g}, not below delta"
            checks.append(below("l2_gain", cost.gain, self.game.delta, reason, kind="gain"))
        return LinearLoop(checks, cost.worst, self._loop_section(K, cost))

    def _loop_section(self, K: np.ndarray, cost: FlightCost) -> Section:
        """Return the section with cost, gain, distance to instability and margins of a loop."""
        game = self.game
        learned, best = _disk_margin(game, K), _disk_margin(game, self.exact.K)
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

    def _stability_checks(self, K: np.ndarray, is_exact: bool) -> list[Check]:
        """Return the checks that A - B K is stable, and in discrete time of a finite cost.

        is_exact: whether K is that of the exact solution
        """
        stable = self._loop_check(
            "control_loop", "A - B K", self.game.A - self.game.B @ K, kind="stability"
        )
        if not self.game.is_discrete:
            return [stable]
        if is_exact and not stable.ok:
            why = "the exact solution of this discounted problem does not stabilize either"
            stable = replace(stable, reason=f"{stable.reason}: {why}")
        discounted = math.sqrt(self.game.discount) * stable.value
        infinite = f"sqrt(discount) (A - B K) has the spectral radius {discounted:.7g}"
        return [stable, below("discounted_loop_radius", discounted, 1.0, infinite, kind="cost")]

    def value_checks(self, P: np.ndarray, limit: float) -> list[Check]:
        """Return the checks of a critic's P: the residual of its equation, and in continuous time
        the loop A - S P and the sign of P.

        - If Q is singular, a smallest eigenvalue of P down to -`INDEFINITENESS` is permitted.
          Rounding can make the value of a state without cost negative.
        - If the limit is above `LIMIT`, the smallest eigenvalue of P may be lower than that of P*
          by the change that |P - P*| <= limit |P*| permits (Weyl).

        P: (n, n)
        limit: limit of the relative residual
        """
        residual = float(self.residuals(P[None])[0])
        name, equation = "riccati_residual", "the Riccati equation"
        if self.game.is_discrete:
            name, equation = "bellman_residual", "Bellman's equation"
        unsolved = f"the residual of {equation} is {residual:.2g}"
        solved = at_most(name, residual, limit, unsolved, kind="error")
        if self.game.is_discrete:
            return [solved]
        scaled, right = self._form.of_value(P), self._form.of_value(self.exact.P)
        costs = np.linalg.eigvalsh(self._form.Q)
        least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
        if limit > LIMIT and right.any():
            allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
            least = min(least, _smallest_eigenvalue(right) - allowed)
        smallest = _smallest_eigenvalue(scaled)
        indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
        return [
            self.game_loop(P),
            at_least("P_smallest_eigenvalue", smallest, least, indefinite, kind="cost"),
            solved,
        ]

    def game_loop(self, P: np.ndarray) -> Check:
        """Return the check that the loop with both policies of the value z'P z is stable."""
        loop = self.game.worst_case_loop((P + P.T) / 2.0)
        if not self.game.is_discrete:
            return self._loop_check("game_loop", "A - S P", loop, kind="game loop")
        discounted = math.sqrt(self.game.discount) * loop
        words = "sqrt(discount) (A - B K + E L)"
        return self._loop_check("game_loop", words, discounted, kind="game loop")

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the relative residuals of the Riccati equation, (N,), for N matrices P."""
        return np.array([self._form.relative_residual(X) for X in self._form.of_value(values)])

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether the loop A - B K is stable."""
        return self._stability(self.game.A - self.game.B @ K).is_stable

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return the cost z'Q z + 2 z'N u + u'R u of a state and an input per second, or step."""
        both = np.hstack([z, u])
        return float(both @ self.game.weights @ both)

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return X (n, n) with J - V* = z'X z for the policy u = -K z (`loss_matrix`).

        The result is None if the cost has no bound.
        """
        return loss_matrix(self.exact, K)

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """
        return self._loop_of(self.game.A, critic, b)

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under the disturbance of u = -K z, the critic's linear part.

        The cost is J - V*. Inputs and disturbances count from their values at the equilibrium.

        b: half-widths of the box of states, (n,)
        X: (n, n), `excess` of K
        """
        game = self.game
        L_above_exact = np.zeros_like(self.exact.disturbance_gain)
        if not game.is_discrete and math.isfinite(game.delta):
            L_above_exact = game.disturbance_gain(X)

        def running(equilibrium: np.ndarray) -> Expression:
            paid = excess_cost_rate(critic.policy, self.exact.K, self.exact.price, equilibrium)
            if not L_above_exact.any():
                return paid
            gained = ca.DM(game.delta * L_above_exact)
            rest = ca.DM(equilibrium)
            return lambda z: paid(z) - ca.sumsqr(gained @ (z - rest))

        return self._loop_of(self._plant(L_above_exact), critic, b, running)

    def plant_loop(self, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray) -> Loop:
        """Return the closed loop of the nonlinear plant with its saturated inputs.

        critic: the critic, or None for the exact policy
        b: half-widths of the box of states, (n,)
        """
        z = ca.SX.sym("z", len(b)) if critic is None else critic.symbols
        u = -ca.DM(self.exact.K) @ z if critic is None else critic.policy(z)
        own = [] if critic is None else [self.game.A - self.game.B @ critic.K]
        seconds = self._duration(*own)
        return flow_loop(z, plant.closed(z, u), self.exact, seconds, b, is_slow=True)

    def _plant(self, more: np.ndarray | float = 0.0) -> np.ndarray:
        """Return A + E (L* + more), (n, n)."""
        return self.game.A + self.game.E @ (self.exact.disturbance_gain + more)

    def _duration(self, *loops: np.ndarray) -> float:
        """Return the duration of a simulation, s or steps, in which the exact loop and linear loops
        decay.

        In continuous time, loops count as at most SLOWEST times slower than the exact one.
        In discrete time, the caller limits the number of steps.

        loops: stable matrices, (n, n)
        """
        discrete = self.game.is_discrete

        def rate(loop: np.ndarray) -> float:
            value = self._stability(loop).value
            return -math.log(min(max(value, 1e-3), 1.0 - 1e-12)) if discrete else abs(value)

        by_exact = rate(self.game.A - self.game.B @ self.exact.K)
        slowest = min([by_exact, *map(rate, loops)])
        return DECAY / (slowest if discrete else max(slowest, by_exact / SLOWEST))

    def _loop_of(
        self,
        A: np.ndarray,
        critic: Critic,
        b: np.ndarray,
        running: Callable[[np.ndarray], Expression] | None = None,
    ) -> Loop:
        """Return the loop z' = A z + B u, in discrete time z⁺ = A z + B u, of a critic's policy.

        A: matrix of the game, with the policy of the disturbance if there is one, (n, n)
        running: equilibrium -> cost per second or step, or None without cost
        """
        linear = A - self.game.B @ critic.K
        if self.game.is_discrete:
            z = symbols_for([critic.policy], len(b))
            next_state = ca.DM(A) @ z + ca.DM(self.game.B) @ critic.policy(z)
            steps = min(math.ceil(self._duration(linear)), STEPS)
            by_exact = A - self.game.B @ self.exact.K
            return step_loop(z, next_state, self.exact, by_exact, steps, b, running)
        z = critic.symbols
        rate = ca.DM(A) @ z + ca.DM(self.game.B) @ critic.policy(z)
        undisturbed = self.game.A - self.game.B @ critic.K
        return flow_loop(z, rate, self.exact, self._duration(undisturbed, linear), b, running)


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
