"""Games in continuous time, as a verdict needs them."""

from __future__ import annotations

import math
from contextlib import suppress
from functools import lru_cache

import casadi as ca
import numpy as np

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.balancing import spectrum
from controller.riccati.certificate import INDEFINITENESS
from controller.riccati.cost import SIGNLESS, FlightCost, flight_cost, loss_matrix
from controller.riccati.gare import unconfirmed_solution
from controller.riccati.margins import DiskMargin, disk_margin
from controller.riccati.normal_form import NormalForm
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_least, at_most, below
from hfa_support.reporting.text import Table
from verification.axis import (
    DECAY,
    SLOWEST,
    Expression,
    LinearLoop,
    Loop,
    cost_of,
    flow_loop,
    quadratic_at,
)
from verification.critic_errors import disturbance_errors
from verification.scope import LIMIT, NonlinearPlant
from verification.verdict import Details, Section


class InTime:
    """Game on the plant z' = A z + B u + E d in continuous time.

    A policy u has the cost J = V* + ∫ (u - u*)'R (u - u*) - δ² (d - d*)'(d - d*) dt. The worst
    disturbance of u = -K z is d = d* + δ⁻² E'X z.

    game: the game

    Raises NoSolutionError if the game has no certified solution.
    """

    name = "linear game"
    solution = "game solution"
    period = "second"

    def __init__(self, game: Game) -> None:
        self.step = game
        self.exact = unconfirmed_solution(game)
        self.price = game.R

    def critic(self, given: Critic) -> Critic:
        """Return the critic unchanged."""
        return given

    def gain(self, P: np.ndarray) -> np.ndarray:
        """Return K = R⁻¹(B'P + N'), (m, n)."""
        return self.step.gain(P)

    def more_errors(self, critic: Critic, box: np.ndarray, limit: float) -> list[Check]:
        """Return the check of the worst disturbance in the box, if there is a disturbance."""
        return disturbance_errors(self.step, critic, self.exact, box, limit)

    def linear_loop(self, critic: Critic, is_exact: bool) -> LinearLoop:
        """Return the checks that A - B K is stable and that its L2 gain is below delta.

        The L2 gain is not checked for delta = inf, or if K is not finite. If rounding hides whether
        A - B K is stable, the cost of K is infinite.
        """
        game = self.step
        K = critic.K
        try:
            lost = flight_cost(game, self.exact, K)
        except NoSolutionError:
            lost = flight_cost(game, self.exact, np.full_like(K, math.inf))
        abscissa = math.inf
        if critic.finite:
            abscissa = spectrum(game.A - game.B @ K).abscissa
        reason = f"A - B K is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
        checks = [below("control_loop_abscissa", abscissa, 0.0, reason, kind="stability")]
        if math.isfinite(game.delta) and critic.finite:
            reason = f"the closed loop has an L2 gain of {lost.gain:.4g}, not below delta"
            checks.append(below("l2_gain", lost.gain, game.delta, reason, kind="gain"))
        return LinearLoop(checks, lost.worst, _loop_section(game, K, lost))

    def value_checks(self, P: np.ndarray, limit: float) -> list[Check]:
        """Return three checks of a critic's P, on the loop A - S P, the sign of P and the residual.

        A - S P must be stable, P must not be indefinite, and the residual of the Riccati equation
        must be small.

        - If Q is singular, a smallest eigenvalue of P down to -`INDEFINITENESS` is permitted.
          Rounding can make the value of a state without cost negative.
        - If the limit is above `LIMIT`, the smallest eigenvalue of P may be lower than that of P*
          by the change that |P - P*| <= limit |P*| permits (Weyl).

        P: (n, n)
        limit: limit of the relative residual of the Riccati equation
        """
        form = NormalForm.of(self.step)
        scaled = form.of_value(P)
        right = form.of_value(self.exact.P)
        residual = float(form.relative_residual(scaled))
        unsolved = f"the residual of the Riccati equation is {residual:.2g}"
        costs = np.linalg.eigvalsh(form.Q)
        least = 0.0 if costs[0] > SIGNLESS * costs[-1] else -INDEFINITENESS
        if limit > LIMIT and right.any():
            allowed = limit * float(np.linalg.norm(right) / np.abs(right).max())
            least = min(least, _smallest_eigenvalue(right) - allowed)
        smallest = _smallest_eigenvalue(scaled)
        indefinite = f"P is indefinite (smallest eigenvalue {smallest:.3g} of its size)"
        return [
            self.game_loop(P),
            at_least("P_smallest_eigenvalue", smallest, least, indefinite, kind="cost"),
            at_most("riccati_residual", residual, limit, unsolved, kind="error"),
        ]

    def game_loop(self, P: np.ndarray) -> Check:
        """Return the check that A - S P is Hurwitz."""
        abscissa = spectrum(self.step.worst_case_loop(P)).abscissa
        unstable = f"A - S P is not Hurwitz (abscissa {abscissa:+.3g} 1/s)"
        return below("game_loop_abscissa", abscissa, 0.0, unstable, kind="game loop")

    def residuals(self, values: np.ndarray) -> np.ndarray:
        """Return the relative residuals of the Riccati equation, in balanced units, (N,)."""
        form = NormalForm.of(self.step)
        return np.asarray(form.relative_residual(form.of_value(values)))

    def exact_at(self, kind: str, z: ca.SX) -> ca.SX:
        """Return the exact function "value", "gradient" or "policy" at the state z, (n,)."""
        return quadratic_at(self.exact, kind, z)

    def is_stable(self, K: np.ndarray) -> bool:
        """Return whether A - B K is Hurwitz."""
        return bool(spectrum(self.step.A - self.step.B @ K).abscissa < 0.0)

    def cost(self, z: np.ndarray, u: np.ndarray) -> float:
        """Return z'Q z + 2 z'N u + u'R u."""
        both = np.hstack([z, u])
        return float(both @ self.step.weights @ both)

    def excess(self, K: np.ndarray) -> np.ndarray | None:
        """Return the `loss_matrix` X of u = -K z, or None if the cost has no bound."""
        return loss_matrix(self.step, self.exact, K)

    def duration(self, *loops: np.ndarray) -> float:
        """Return the duration of a simulation, s, in which the exact loop and linear loops decay.

        loops: stable matrices, (n, n)
        """
        by_exact = abs(spectrum(self.step.A - self.step.B @ self.exact.K).abscissa)
        slowest = min([by_exact, *(abs(spectrum(loop).abscissa) for loop in loops)])
        return DECAY / max(slowest, by_exact / SLOWEST)

    def loop(self, critic: Critic, b: np.ndarray) -> Loop:
        """Return the closed loop without disturbance.

        b: half-widths of the box of states, (n,)
        """
        z = critic.symbols
        rates = ca.DM(self.step.A) @ z + ca.DM(self.step.B) @ critic.policy(z)
        duration = self.duration(self.step.A - self.step.B @ critic.K)
        return flow_loop(z, rates, self.exact, duration, b)

    def plant_loop(
        self, plant: NonlinearPlant, critic: Critic | None, b: np.ndarray
    ) -> Loop | None:
        """Return the closed loop of the nonlinear plant with its saturated inputs.

        critic: the critic, or None for the exact policy
        b: half-widths of the box of states, (n,)
        """
        z = ca.SX.sym("z", len(b)) if critic is None else critic.symbols
        u = -ca.DM(self.exact.K) @ z if critic is None else critic.policy(z)
        rates = plant.closed(z, u)
        return flow_loop(z, rates, self.exact, self.duration(), b, is_slow=True)

    def worst_loop(self, critic: Critic, b: np.ndarray, X: np.ndarray) -> Loop:
        """Return the closed loop under d = d* + δ⁻² E'X z.

        The running cost is v'R v - δ² w'w, with v = u - u* and w = d - d* minus their values at the
        equilibrium.
        """
        game = self.step
        z = critic.symbols
        more = game.disturbance_gain(X)
        plant = game.A + game.E @ (self.exact.disturbance_gain + more)
        rates = ca.DM(plant) @ z + ca.DM(game.B) @ critic.policy(z)
        duration = self.duration(game.A - game.B @ critic.K, plant - game.B @ critic.K)

        def running(equilibrium: np.ndarray) -> Expression:
            paid = cost_of(critic.policy, self.exact.K, self.price, equilibrium)
            if not math.isfinite(game.delta):
                return paid
            gained = ca.DM(game.delta * more)
            rest = ca.DM(equilibrium)
            return lambda z: paid(z) - ca.sumsqr(gained @ (z - rest))

        return flow_loop(z, rates, self.exact, duration, b, running)


def _smallest_eigenvalue(P: np.ndarray) -> float:
    """Return the smallest eigenvalue of (P + P')/2, relative to the largest entry of |P|."""
    return float(np.linalg.eigvalsh((P + P.T) / 2.0)[0] / np.abs(P).max()) if np.any(P) else 0.0


def _loop_section(game: Game, K: np.ndarray, lost: FlightCost) -> Section:
    """Return a section of the report that compares a critic with the optimum."""
    learned = None
    if math.isfinite(lost.gain):
        with suppress(NoSolutionError):
            learned = disk_margin(game, K)
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


def _margin(margin: DiskMargin | None, name: str) -> str:
    return "-" if margin is None else f"{getattr(margin, name):.4g}"
