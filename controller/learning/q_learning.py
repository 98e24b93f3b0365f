"""Discrete-time Q-learning from recorded steps: value iteration, followed by policy iteration.

Each step (x, u, w, x⁺), with x⁺ of the fit to the data, gives one equation that is linear in the
weights H of Q(x, u, w) = [x; u; w]'H [x; u; w]. Source: Al-Tamimi, Lewis and Abu-Khalaf,
Automatica 43 (2007), 473-481; Lagoudakis and Parr, J. Machine Learning Research 4 (2003),
1107-1149.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from controller.critic.training_run import SETTLED, Excitation, TrainingRun
from controller.game.basis import Basis, basis, q_extremum, q_function
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game, is_definite
from controller.learning.recording import RelativeResidual, excitation, plant_of, refuse_poor
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import quadratic_forms, spectral_radius
from hfa_support.progress import Progress

#: Number of pauses, after 1, 2, 4, ... value iterations, at which policy iteration is tried.
PAUSES = 12
#: Largest number of policy iterations in a trial. They converge quadratically.
MOST_POLICIES = 12


def learn_steps(
    game: Game, begins: np.ndarray, seed: int, progress: Progress | None
) -> TrainingRun:
    """Return the training run of Q-learning on a game in discrete time, from recorded steps.

    Value iteration H <- cost + α extremum of H at x⁺ starts from 0. After 1, 3, 7, ... value
    iterations, policy iteration is tried. Learning ends if policy iteration converges to a policy
    that stabilizes the linear fit of the steps.

    game: the game with the plant that was fitted to the data
    begins: (x, u, w) of the recorded steps, (N, s); w only for a finite delta
    seed: seed of the data, which is reported
    progress: called before each block of value iterations, or None

    Raises BadInputError if R is singular, or if the steps do not determine H.
    Raises NoSolutionError if the disturbance gains more than it costs, or if the iteration diverges
    or does not converge.
    """
    if not is_definite(game.R):
        raise BadInputError(
            "R is singular: Q-learning begins with the cost of one step, which then has no minimum"
            " over u; give R > 0, or solve the game with hfa.solve"
        )
    learner = QLearner(game, begins)
    refuse_poor(learner.excitation)
    P = np.zeros_like(game.A)
    for pause in range(PAUSES):
        if progress is not None:
            progress(pause, PAUSES, f"{learner.iterations} iterations")
        for _ in range(2**pause):
            H = learner.value_iteration(P)
            P = q_extremum(game, H)["P"]
        with suppress(BadInputError, np.linalg.LinAlgError):
            for _ in range(MOST_POLICIES):
                before, H = H, learner.policy_iteration(H)
                if learner.is_settled(before, H):
                    return learner.training_run(H, seed)
    raise NoSolutionError(
        f"Q-learning did not converge in {learner.iterations} iterations; check with `hfa solve`"
        " that a stabilizing policy exists and that delta is large enough, or record smaller steps"
    )


@dataclass(eq=False)
class QLearner:
    """Iterations of the Q-function H, (s, s), on recorded steps.

    game: the game with the plant that was fitted to the data
    begins: (x, u, w) of the recorded steps, (N, s)
    iterations: number of iterations so far
    """

    game: Game
    begins: np.ndarray
    iterations: int = 0

    @cached_property
    def ends(self) -> np.ndarray:
        """States after the steps, of the fit, (N, n)."""
        return self.begins @ plant_of(self.game, self.begins.shape[1]).T

    @cached_property
    def psi(self) -> Basis:
        """Quadratic basis of (x, u, w), with M functions."""
        return basis("quadratic", self.begins.shape[1])

    @cached_property
    def scales(self) -> np.ndarray:
        """Root mean square of each column of (x, u, w), (s,)."""
        return np.sqrt(np.mean(self.begins**2, axis=0))

    @cached_property
    def features(self) -> np.ndarray:
        """Basis functions of the scaled (x, u, w) at the steps, (N, M)."""
        return self.psi.psi(self.begins / self.scales)

    @cached_property
    def inverse(self) -> np.ndarray:
        """Pseudoinverse of the features, (M, N)."""
        return np.linalg.pinv(self.features)

    @cached_property
    def costs(self) -> np.ndarray:
        """Cost of each step, (N,)."""
        weights = q_function(self.game, np.zeros_like(self.game.A))
        return quadratic_forms(self.begins, weights)

    @cached_property
    def excitation(self) -> Excitation:
        """Excitation of the weights of H by the steps."""
        return excitation(self.features)

    def value_iteration(self, P: np.ndarray) -> np.ndarray:
        """Return H for the cost of a step followed by the cost α x⁺'P x⁺.

        Raises NoSolutionError if w gains more than it costs, or if the value diverges.
        """
        self.iterations += 1
        H = self._of_weights(self.inverse @ (self.costs + self._after(P)))
        is_moderate = bool(np.abs(H).max() <= LARGEST_CRITIC_ENTRY)
        if is_moderate and self.has_saddle(H):
            return H
        if is_moderate and np.isfinite(self.game.delta):
            raise NoSolutionError(
                f"at delta = {self.game.delta:g}, the disturbance increases the cost "
                "without bound; choose a larger delta (`hfa solve` reports the smallest)"
            )
        raise NoSolutionError(
            "Q-learning diverges; check with `hfa solve` that a stabilizing policy exists"
        )

    def policy_iteration(self, H: np.ndarray) -> np.ndarray:
        """Return the Q-function of the policies that are optimal for H, applied from x⁺ on.

        Its weights h solve h = inverse (costs + α features_after h), with the features of the
        policies at x⁺.
        """
        self.iterations += 1
        optimum = q_extremum(self.game, H)
        rows = [np.eye(len(self.game.A)), -optimum["K"]]  # (x, u, w) = rows x
        if "L" in optimum:
            rows.append(optimum["L"])
        begins_after = self.ends @ np.vstack(rows).T
        features_after = self.psi.psi(begins_after / self.scales)
        equations = np.eye(self.psi.size) - self.game.discount * self.inverse @ features_after
        return self._of_weights(np.linalg.solve(equations, self.inverse @ self.costs))

    def has_saddle(self, H: np.ndarray) -> bool:
        """Return whether the quadratic form of H has a minimum over u and a maximum over w."""
        n, m = self.game.B.shape
        scaled = H * np.outer(self.scales, self.scales)
        of_inputs = np.linalg.eigvalsh(scaled[n : n + m, n : n + m])
        of_disturbances = np.linalg.eigvalsh(scaled[n + m :, n + m :])
        return bool((of_inputs > 0.0).all() and (of_disturbances < 0.0).all())

    def is_settled(self, before: np.ndarray, after: np.ndarray) -> bool:
        """Return whether policy iteration has converged to a stabilizing policy.

        The block of H over the states changes by at most `SETTLED`, H has a saddle point, and the
        fit of the steps, times √α, is stable with K, and with K and L.

        before, after: H of consecutive iterations
        """
        n = len(self.game.A)
        squares = np.outer(self.scales, self.scales)[:n, :n]
        change = np.abs((after - before)[:n, :n] * squares).max()
        if change > SETTLED * np.abs(after[:n, :n] * squares).max() or not self.has_saddle(after):
            return False
        policies = q_extremum(self.game, after)
        loops = [self.game.A - self.game.B @ policies["K"]]
        if "L" in policies:
            loops.append(loops[0] + self.game.E @ policies["L"])
        root = np.sqrt(self.game.discount)
        return all(root * spectral_radius(loop) < 1.0 for loop in loops)

    def residual(self, H: np.ndarray) -> RelativeResidual:
        """Return the residual of Bellman's equation over all steps."""
        values = quadratic_forms(self.begins, H)
        after = self._after(q_extremum(self.game, H)["P"])
        terms = np.abs(values) + np.abs(self.costs) + np.abs(after)
        return RelativeResidual.of(values - self.costs - after, self.costs, terms)

    def training_run(self, H: np.ndarray, seed: int) -> TrainingRun:
        """Return the result of the last iteration."""
        residual = self.residual(H)
        optimum = q_extremum(self.game, H)
        values = basis("quadratic", len(self.game.A))
        return TrainingRun(
            law="Q-learning",
            basis=values.name,
            W=values.weights(optimum["P"]),
            residual_norm=residual.to_costs,
            settling_residual=residual.to_terms,
            K=optimum["K"],
            excitation=self.excitation,
            seed=seed,
            names=self.game.names,
            H=H,
        )

    def _after(self, P: np.ndarray) -> np.ndarray:
        """Return the cost α x⁺'P x⁺ after each step, (N,)."""
        return self.game.discount * quadratic_forms(self.ends, P)

    def _of_weights(self, weights: np.ndarray) -> np.ndarray:
        """Return H, (s, s), of weights (M,) in the scaled (x, u, w)."""
        return self.psi.matrix(weights) / np.outer(self.scales, self.scales)
