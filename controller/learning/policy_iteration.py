"""Policy iteration on recorded samples: the solution of a game from data.

An iteration evaluates the policies u = -R⁻¹B'P z and d = s δ⁻²E'P z of the last P at the recorded
states z_j. With the recorded drifts F_j = A z_j, the weights W of their value z'P z = W'ψ(z) are
the least-squares solution of

    W'∂ψ_j (F_j - β z_j - S_s P z_j) = -z_j'(Q + P S_s P) z_j,   S_s = B R⁻¹B' - s E E'/δ².

The iterations begin with u = 0 and a discount rate β that makes the plant stable. They lower β to 0
(Kleinman 1968), and then raise s from 0 to 1 (Basar and Bernhard 1995).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis, basis
from controller.game.zero_sum import Game
from controller.learning.recording import (
    RelativeResidual,
    excitation,
    refuse_poor,
    residual_of_value,
)
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import quadratic_forms, spectral_abscissa
from hfa_support.progress import Progress

#: Stability margin of the plant with the initial discount, 1/s.
FIRST_MARGIN = 0.5
#: A relative step of P below this has converged. A step below `SMALL` that no longer halves has
#: reached rounding.
CONVERGED, SMALL = 1e-12, 1e-6
#: Largest number of iterations for a discount, and for a share of 1/δ². If more are needed, a
#: smaller step of the share is tried.
MOST_ITERATIONS, MOST_OF_A_SHARE = 60, 12
#: Smallest relative step of the discount and of the share. If it fails, no solution exists.
SMALLEST_STEP = 1e-9
#: Largest negative eigenvalue of P >= 0 that rounding may cause, relative to the largest entry.
ROUNDED = 1e-10


class Problem(NamedTuple):
    """Problem between the discounted LQ problem (share 0) and the game (discount 0, share 1).

    discount: β >= 0, 1/s
    share: s in [0, 1], the fraction of 1/δ²
    """

    discount: float
    share: float


@dataclass(frozen=True, eq=False)
class RecordedGame:
    """Samples of a plant with the known parts of its game, in the coordinates y = z / scales.

    The game has no cross weights.

    psi: quadratic basis, with M functions
    states, drifts: y_j and their rates without input, (N, n)
    control: B R⁻¹B', (n, n)
    disturbance: E E'/δ², (n, n)
    Q: (n, n)
    """

    psi: Basis
    states: np.ndarray
    drifts: np.ndarray
    control: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray

    @classmethod
    def of(cls, game: Game, states: np.ndarray, scales: np.ndarray) -> RecordedGame:
        """Return the states and the game without cross weights, in scaled coordinates."""
        outer = np.outer(scales, scales)
        return cls(
            psi=basis("quadratic", len(scales)),
            states=states / scales,
            drifts=states @ game.A.T / scales,
            control=game.S_control / outer,
            disturbance=game.S_disturbance / game.delta**2 / outer,
            Q=game.Q * outer,
        )

    @cached_property
    def gradient(self) -> np.ndarray:
        """∂ψ_j, (N, M, n)."""
        return self.psi.gradient(self.states)

    @cached_property
    def fitted(self) -> np.ndarray:
        """Least-squares fit of A to the drifts, (n, n), used only to test stability."""
        return np.asarray(np.linalg.lstsq(self.states, self.drifts, rcond=None)[0].T)

    def S(self, problem: Problem) -> np.ndarray:
        """S_s = B R⁻¹B' - s E E'/δ², (n, n)."""
        return self.control - problem.share * self.disturbance

    def regressors(self, P: np.ndarray, problem: Problem) -> np.ndarray:
        """Return the rates of the basis functions under the policies of P, (N, M)."""
        by_policies = self.states @ (self.S(problem) @ P).T
        rates = self.drifts - problem.discount * self.states - by_policies
        return np.asarray(np.einsum("jmi,ji->jm", self.gradient, rates))

    def evaluated(self, P: np.ndarray, problem: Problem) -> np.ndarray:
        """Return the matrix (n, n) of the value of the policies of P.

        The equations are divided by the lengths of their rows, and the weights are those of columns
        of equal length.
        """
        regressors = self.regressors(P, problem)
        costs = quadratic_forms(self.states, self.Q + P @ self.S(problem) @ P)
        row_lengths = np.linalg.norm(regressors, axis=1)
        equations = regressors / row_lengths[:, None]
        column_lengths = np.linalg.norm(equations, axis=0)
        scaled, *_ = np.linalg.lstsq(equations / column_lengths, -costs / row_lengths, rcond=None)
        return self.psi.matrix(scaled / column_lengths)

    def iterated(self, P: np.ndarray, problem: Problem, most: int) -> np.ndarray | None:
        """Return P (n, n) after policy iterations for a problem, or None without convergence."""
        step = np.inf
        for _ in range(most):
            with np.errstate(all="ignore"):
                try:
                    after = self.evaluated(P, problem)
                except np.linalg.LinAlgError:  # a number is not finite
                    return None
                last, step = step, float(np.linalg.norm(after - P) / np.linalg.norm(after))
            P = after
            if not np.isfinite(step):
                return None
            if step < CONVERGED or (last < SMALL and step > 0.5 * last):
                return P
        return P if step < SMALL else None

    def margin(self, P: np.ndarray, problem: Problem) -> float:
        """Return the stability margin of A - βI - S_s P, 1/s, positive for a stable loop."""
        loop = self.fitted - self.S(problem) @ P
        return problem.discount - spectral_abscissa(loop)

    def residual(self, P: np.ndarray) -> RelativeResidual:
        """Return the residual of the game's equation for the value y'P y."""
        slopes = 2.0 * self.states @ P
        costs = quadratic_forms(self.states, self.Q)
        return residual_of_value(slopes, self.drifts, costs, self.S(Problem(0.0, 1.0)))


def without_discount(recorded: RecordedGame, progress: Progress | None) -> np.ndarray:
    """Return P (n, n) of the LQ problem, from u = 0 and a discount that is lowered to 0.

    Each step lowers the discount by half the stability margin, so that the policy remains
    stabilizing.

    Raises NoSolutionError if a mode cannot be stabilized.
    """
    first = max(0.0, spectral_abscissa(recorded.fitted) + FIRST_MARGIN)
    discount, P = first, np.zeros_like(recorded.Q)
    while True:
        problem = Problem(discount, 0.0)
        P_of_discount = recorded.iterated(P, problem, MOST_ITERATIONS)
        margin = -np.inf if P_of_discount is None else recorded.margin(P_of_discount, problem)
        if P_of_discount is None or margin <= 0.0:
            raise _unstable_mode(discount)
        if discount == 0.0:
            return P_of_discount
        if progress is not None:
            progress(0.5 * (1.0 - discount / first), 1.0, f"discount {discount:.3g} 1/s")
        P, last = P_of_discount, discount
        discount = max(0.0, discount - 0.5 * margin)
        if discount > (1.0 - SMALLEST_STEP) * last:
            raise _unstable_mode(last)


def _unstable_mode(discount: float) -> NoSolutionError:
    """Return the error that policies at a discount rate leave a mode unstable."""
    return NoSolutionError(
        f"the discount cannot be lowered below {discount:.6g} 1/s, where the learned policies "
        "leave a mode unstable; check that (A, B) is stabilizable and that Q weights the mode"
    )


def with_disturbance(
    recorded: RecordedGame, P: np.ndarray, delta: float, progress: Progress | None
) -> np.ndarray:
    """Return P (n, n) of the game, from P of the LQ problem and a share that is raised to 1.

    A share is accepted if the iterations converge to a P >= 0 with a stable A - S_s P, which is
    unique. Otherwise half the step is tried.

    Raises NoSolutionError, with the δ at which the solution ceases to exist.
    """
    share, step = 0.0, 1.0
    while share < 1.0 and recorded.disturbance.any():
        problem = Problem(0.0, min(1.0, share + step))
        P_of_share = recorded.iterated(P, problem, MOST_OF_A_SHARE)
        if P_of_share is not None and _is_solution(recorded, P_of_share, problem):
            P, share, step = P_of_share, problem.share, 2.0 * step
        else:
            step /= 2.0
            if step < SMALLEST_STEP:
                end = delta / np.sqrt(share) if share > 0.0 else np.inf
                raise NoSolutionError(
                    f"the law finds no solution for delta = {delta:g}, because the solution ceases "
                    f"to exist at delta = {end:.6g}; choose a larger delta (`hfa solve` reports "
                    "the smallest)"
                )
        if progress is not None:
            progress(0.5 * (1.0 + share), 1.0, f"share {share:.3g} of 1/delta²")
    return P


def _is_solution(recorded: RecordedGame, P: np.ndarray, problem: Problem) -> bool:
    """Return whether P >= 0 up to rounding, and the loop of its policies is stable."""
    smallest = float(np.linalg.eigvalsh(P)[0])
    return recorded.margin(P, problem) > 0.0 and smallest > -ROUNDED * float(np.abs(P).max())


def policy_iteration(
    game: Game, states: np.ndarray, seed: int, progress: Progress | None
) -> TrainingRun:
    """Return the training run of policy iteration on recorded states.

    game: the game with the plant that was fitted to the data
    states: recorded states, (N, n)
    seed: seed of the data, which is reported
    progress: called with (fraction done, 1, text), or None

    Raises BadInputError if the samples do not determine the weights. Raises NoSolutionError if
    (A, B) is not stabilizable, or the game has no solution at its δ.
    """
    scales = np.sqrt(np.mean(states**2, axis=0))
    recorded = RecordedGame.of(game.without_cross_weights, states, scales)
    of_samples = excitation(recorded.psi.psi(recorded.states))
    refuse_poor(of_samples)
    P = with_disturbance(recorded, without_discount(recorded, progress), game.delta, progress)
    residual = recorded.residual(P)
    value = P / np.outer(scales, scales)
    return TrainingRun(
        law="policy-iteration",
        basis="quadratic",
        W=recorded.psi.weights(value),
        residual_norm=residual.to_costs,
        settling_residual=residual.to_terms,
        K=game.gain(value),
        excitation=of_samples,
        seed=seed,
        names=game.names,
    )
