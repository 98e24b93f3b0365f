"""Policy iteration on recorded samples: the solution of a game from data.

An iteration evaluates the policies u = -R⁻¹B'P z and d = s δ⁻²E'P z of the last P at the recorded
states z_j. With the recorded drifts F_j = A z_j, the weights W of their value z'P z = W'ψ(z) are
the least-squares solution of

    W'∂ψ_j (F_j - β z_j - S_s P z_j) = -z_j'(Q + P S_s P) z_j,   S_s = B R⁻¹B' - s E E'/δ².

The iterations begin with u = 0 and a discount rate β that makes the plant stable. They lower β to 0
(Kleinman 1968), and then raise s from 0 to 1 (Basar and Bernhard 1995), in steps that succeed.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller.learning.recording import Learned, Samples, root_mean_square
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import quadratic_forms, spectral_abscissa
from hfa_support.progress import Progress

#: Stability margin of the plant with the initial discount, 1/s.
FIRST_MARGIN = 0.5
#: A relative step of P below this has converged. A step below `SMALL` that no longer halves has
#: reached rounding.
CONVERGED, SMALL = 1e-12, 1e-6
#: Largest number of iterations for a problem. If more are needed, a smaller step is tried.
MOST_ITERATIONS = 60
#: Smallest step of the discount and of the share of 1/δ², relative to the whole way of each.
SMALLEST_STEP = 1e-9
#: Largest negative eigenvalue of P >= 0 that rounding may cause, relative to the largest entry.
NEGATIVE_BY_ROUNDING = 1e-10


class Problem(NamedTuple):
    """Problem between the discounted LQ problem (share 0) and the game (discount 0, share 1).

    discount: β >= 0, 1/s
    share: s in [0, 1], the fraction of 1/δ²
    """

    discount: float
    share: float


class Iteration(Samples):
    """Policy iteration on the samples of a game, with a quadratic basis.

    The policies u = -R⁻¹B'P z and d = s δ⁻²E'P z of a P have the loop z' = (A - S_s P) z, with
    S_s = B R⁻¹B' - s E E'/δ². Samples are states z_j and their drifts F_j = A z_j. The value of the
    policies is z'P⁺z = W'ψ(z), with the basis ψ of quadratic monomials and its derivatives ∂ψ_j at
    z_j. The weights W solve at each sample

        W'∂ψ_j (F_j - β z_j - S_s P z_j) = -z_j'(Q + P S_s P) z_j.

    The discount rate β and the share s of the disturbance are those of a `Problem`.
    """

    def S(self, problem: Problem) -> np.ndarray:
        """S_s = B R⁻¹B' - s E E'/δ², (n, n)."""
        game = self.game
        return game.S_control - problem.share * (game.E @ game.E.T) / game.delta**2

    def evaluated(self, P: np.ndarray, problem: Problem) -> np.ndarray:
        """Return the matrix P⁺ (n, n) of the value of the policies of P, by least squares.

        For accuracy, each equation is divided by the length of its row, and then each column by its
        length.
        """
        S = self.S(problem)
        rates = self.drifts - problem.discount * self.states - self.states @ (S @ P).T
        regressors = np.einsum("jmi,ji->jm", self.gradient, rates)  # ∂ψ_j times rates_j, (N_h, M)
        costs = self.costs + quadratic_forms(self.states, P @ S @ P)
        row_lengths = np.linalg.norm(regressors, axis=1)
        equations = regressors / row_lengths[:, None]
        column_lengths = np.linalg.norm(equations, axis=0)
        scaled, *_ = np.linalg.lstsq(equations / column_lengths, -costs / row_lengths, rcond=None)
        return self.psi.matrix(scaled / column_lengths)

    def iterated(self, P: np.ndarray, problem: Problem) -> np.ndarray | None:
        """Return P (n, n) after policy iterations for a problem, or None without convergence."""
        step = np.inf
        for _ in range(MOST_ITERATIONS):
            with np.errstate(all="ignore"):
                try:
                    after = self.evaluated(P, problem)
                except np.linalg.LinAlgError:  # a number is not finite
                    return None
                last, step = step, float(np.linalg.norm(after - P) / np.linalg.norm(after))
            P = after
            if not np.isfinite(step):
                return None
            # Relative to P, the step is small, or no longer halves because of rounding.
            if step < CONVERGED or (last < SMALL and step > 0.5 * last):
                return P
        return P if step < SMALL else None

    def is_solved(self, P: np.ndarray, problem: Problem) -> bool:
        """Return whether P >= 0 up to rounding, and A - S_s P - βI is stable."""
        loop = self.game.A - self.S(problem) @ P
        smallest = np.linalg.eigvalsh(P)[0]
        is_semidefinite = smallest > -NEGATIVE_BY_ROUNDING * np.abs(P).max()
        return is_semidefinite and spectral_abscissa(loop) < problem.discount


def policy_iteration(samples: Samples, progress: Progress | None) -> Learned:
    """Return the weights of the value of a game that policy iteration learns from samples.

    samples: with a quadratic basis
    progress: called with (fraction done, 1, text), or None

    Raises NoSolutionError if (A, B) is not stabilizable, or, with the δ at which the solution
    ceases to exist, if the game has none.
    """
    game = samples.game

    # The same game in states z / scales, whose sizes are 1.
    scales = root_mean_square(samples.states)
    products_of_scales = np.outer(scales, scales)
    A, B, E = (M / scales[:, None] for M in (game.A * scales, game.B, game.E))
    scaled = replace(game, A=A, B=B, E=E, Q=game.Q * products_of_scales)
    iteration = Iteration(scaled, samples.psi, samples.states / scales)

    # Places 0 to 1 lower the discount to 0, without disturbance. Places 1 to 2 raise the share of
    # 1/δ² to 1. P of a problem begins the iterations of the next one. The step is doubled if they
    # converge to the only P >= 0 that stabilizes the discounted plant, and otherwise halved.
    first_discount = max(0.0, spectral_abscissa(A) + FIRST_MARGIN)  # u = 0 is stable with it
    P, place, step = np.zeros_like(A), 0.0, 1.0
    while place < 2.0 and step >= SMALLEST_STEP:
        tried = min(place + step, 1.0 if place < 1.0 else 2.0)
        problem = Problem(max(1.0 - tried, 0.0) * first_discount, max(tried - 1.0, 0.0))
        after = iteration.iterated(P, problem)
        if after is not None and iteration.is_solved(after, problem):
            P, place, step = after, tried, 2.0 * step
        else:
            step /= 2.0
        if progress is not None:
            told = f"discount {problem.discount:.3g} 1/s, share {problem.share:.3g} of 1/delta²"
            progress(0.5 * place, 1.0, told)
    if place < 1.0:
        raise NoSolutionError(
            f"the discount cannot be lowered below {(1.0 - place) * first_discount:.6g} 1/s, "
            "where the learned policies leave a mode unstable; check that (A, B) is stabilizable "
            "and that Q weights the mode"
        )
    if place < 2.0:  # solved up to share / δ²
        share = place - 1.0
        end = game.delta / np.sqrt(share) if share else np.inf
        raise NoSolutionError(
            f"the law finds no solution for delta = {game.delta:g}, because the solution ceases to "
            f"exist at delta = {end:.6g}; choose a larger delta (`hfa solve` reports the smallest)"
        )
    weights = samples.psi.weights(P / products_of_scales)  # in the units of the samples
    return Learned(weights, samples.residual(weights))
