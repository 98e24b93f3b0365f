"""Discrete-time Q-learning from steps: value iteration, followed by policy iteration.

Each step (x, u, w, x⁺) gives one equation that is linear in the
weights H of Q(x, u, w) = [x; u; w]'H [x; u; w]. Source: Al-Tamimi, Lewis and Abu-Khalaf,
Automatica 43 (2007), 473-481; Lagoudakis and Parr, J. Machine Learning Research 4 (2003),
1107-1149.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from controller.critic.training_run import SETTLED
from controller.game.basis import basis, q_extremum
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game, is_definite, q_function
from controller.learning.recording import Learned, drawn, plant_of, root_mean_square
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import quadratic_forms, spectral_radius
from hfa_support.progress import Progress

#: Number of pauses, after 1, 2, 4, ... value iterations, at which policy iteration is tried.
PAUSES = 12
#: Largest number of policy iterations in a trial. They converge quadratically.
MOST_POLICY_ITERATIONS = 12


def learn_steps(game: Game, seed: int, progress: Progress | None) -> Learned:
    """Return what Q-learning learns of a game in discrete time, from steps that are drawn for it.

    Value iteration H <- cost + α extremum of H at x⁺ starts from 0. After 1, 3, 7, ... value
    iterations, policy iteration is tried. Learning ends if policy iteration converges to a policy
    that stabilizes the plant of the game.

    game: the game, with the plant that was fitted to data, if any
    seed: seed of the steps
    progress: called before each block of value iterations, or None

    Raises BadInputError if R is singular.
    Raises NoSolutionError if the disturbance gains more than it costs, or if the iteration diverges
    or does not converge.
    """
    if not is_definite(game.R):
        raise BadInputError(
            "R is singular: Q-learning begins with the cost of one step, which then has no minimum"
            " over u; give R > 0, or solve the game with hfa.solve"
        )
    learner = QLearner(game, drawn(game, seed))
    P = np.zeros_like(game.A)
    for pause in range(PAUSES):
        if progress is not None:
            progress(pause, PAUSES, f"{2**pause} value iterations")
        for _ in range(2**pause):
            H = learner.value_iteration(P)
            P = q_extremum(game, H)["P"]
        # From an H too far from the optimum, policy iteration may meet an H without extremum.
        with suppress(BadInputError, np.linalg.LinAlgError):
            for _ in range(MOST_POLICY_ITERATIONS):
                before, H = H, learner.policy_iteration(H)
                if learner.is_settled(before, H):
                    return learner.learned(H)
    raise NoSolutionError(
        f"Q-learning did not converge in {2**PAUSES} iterations; check with `hfa solve`"
        " that a stabilizing policy exists and that delta is large enough, or record smaller steps"
    )


@dataclass(eq=False)
class QLearner:
    """Iterations of the Q-function H, (s, s), on steps.

    game: the game, with the plant that was fitted to data, if any
    begins: (x, u, w) of the steps, (N, s); w only for a finite delta
    ends: x⁺ of the steps, (N, n)
    costs: cost of each step, (N,)
    scales: root mean squares of the columns of `begins`, (s,)
    products_of_scales: scales scales', which makes H one of (x, u, w) / scales
    pseudoinverse: of all products of two entries of (x, u, w) / scales, (N, M). Times values of Q
        at the steps, it is the weights of H
    """

    game: Game
    begins: np.ndarray

    def __post_init__(self) -> None:
        """Compute what all iterations use, with features of (x, u, w) in units of their sizes."""
        size = self.begins.shape[1]
        self.scales = root_mean_square(self.begins)
        self.products_of_scales = np.outer(self.scales, self.scales)
        self.ends = self.begins @ plant_of(self.game, size).T
        self.psi = basis("quadratic", size)
        self.pseudoinverse = np.linalg.pinv(self.psi.psi(self.begins / self.scales))
        cost_matrix = q_function(self.game, np.zeros_like(self.game.A))  # no cost after the step
        self.costs = quadratic_forms(self.begins, cost_matrix)

    def value_iteration(self, P: np.ndarray) -> np.ndarray:
        """Return H for the cost of a step followed by the cost α x⁺'P x⁺.

        Raises NoSolutionError if w gains more than it costs, or if the value diverges.
        """
        weights = self.pseudoinverse @ (self.costs + self._costs_after(P))
        H = self.psi.matrix(weights) / self.products_of_scales
        is_moderate = bool(np.abs(H).max() <= LARGEST_CRITIC_ENTRY)
        if is_moderate and self.has_saddle(H):
            return H
        if is_moderate and np.isfinite(self.game.delta):  # no maximum over w
            raise NoSolutionError(
                f"at delta = {self.game.delta:g}, the disturbance increases the cost "
                "without bound; choose a larger delta (`hfa solve` reports the smallest)"
            )
        raise NoSolutionError(
            "Q-learning diverges; check with `hfa solve` that a stabilizing policy exists"
        )

    def policy_iteration(self, H: np.ndarray) -> np.ndarray:
        """Return the Q-function of the policies that are optimal for H, applied from x⁺ on.

        Its weights h solve h = pseudoinverse (costs + α features_after h), with the features of the
        policies at x⁺.
        """
        optimum = q_extremum(self.game, H)
        rows = [np.eye(len(self.game.A)), -optimum["K"]]  # (x, u, w) = rows x
        if "L" in optimum:
            rows.append(optimum["L"])
        features_after = self.psi.psi(self.ends @ np.vstack(rows).T / self.scales)
        equations = np.eye(self.psi.size) - self.game.discount * self.pseudoinverse @ features_after
        weights = np.linalg.solve(equations, self.pseudoinverse @ self.costs)
        return self.psi.matrix(weights) / self.products_of_scales

    def has_saddle(self, H: np.ndarray) -> bool:
        """Return whether the quadratic form of H has a minimum over u and a maximum over w."""
        n, m = self.game.B.shape
        scaled = H * self.products_of_scales
        of_inputs, of_disturbances = scaled[n : n + m, n : n + m], scaled[n + m :, n + m :]
        return all(is_definite(block) for block in (of_inputs, -of_disturbances) if block.size)

    def is_settled(self, before: np.ndarray, after: np.ndarray) -> bool:
        """Return whether policy iteration has converged to a stabilizing policy.

        The block of H over the states changes by at most `SETTLED`, H has a saddle point, and the
        discounted loop √α (A - B K) is stable, also with the worst disturbance L x.

        before, after: H of consecutive iterations
        """
        n = len(self.game.A)
        last, now = ((H * self.products_of_scales)[:n, :n] for H in (before, after))
        if np.abs(now - last).max() > SETTLED * np.abs(now).max() or not self.has_saddle(after):
            return False
        policies = q_extremum(self.game, after)
        loop = self.game.A - self.game.B @ policies["K"]
        loops = [loop, loop + self.game.E @ policies["L"]] if "L" in policies else [loop]
        root = np.sqrt(self.game.discount)
        return all(root * spectral_radius(loop) < 1.0 for loop in loops)

    def learned(self, H: np.ndarray) -> Learned:
        """Return the result of the last iteration, with the residual of Bellman's equation."""
        P = q_extremum(self.game, H)["P"]
        errors = quadratic_forms(self.begins, H) - self.costs - self._costs_after(P)
        residual = float(np.linalg.norm(errors) / np.linalg.norm(self.costs))
        return Learned(basis("quadratic", len(P)).weights(P), residual, H=H)

    def _costs_after(self, P: np.ndarray) -> np.ndarray:
        """Return the cost α x⁺'P x⁺ after each step, (N,)."""
        return self.game.discount * quadratic_forms(self.ends, P)
