"""Discrete-time Q-learning from recorded steps: value iteration, followed by policy iteration.

A, B and E are not used. Each step (x, u, w, x⁺) gives one equation that is linear in the weights H
of Q(x, u, w) = [x; u; w]'H [x; u; w]. Source: Al-Tamimi, Lewis and Abu-Khalaf, Automatica 43
(2007), 473-481; Lagoudakis and Parr, J. Machine Learning Research 4 (2003), 1107-1149.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from controller.critic.training_run import SETTLED, TrainingRun
from controller.game.basis import Basis, basis
from controller.game.q_function import of_q_function, q_function
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game, is_definite
from controller.learning.recording import excitation, natural_spread, rank, refuse_poor, unit_rows
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import LARGEST, checked_matrix
from hfa_support.progress import Progress
from hfa_support.reporting.report import Reported

#: Number of pauses, after 1, 2, 4, ... value iterations, at which policy iteration is tried.
PAUSES = 12
#: Largest number of policy iterations in a trial. They converge quadratically.
MOST_POLICIES = 12
#: Number of recorded steps for each weight of H.
STEPS_PER_WEIGHT = 3


@dataclass(frozen=True, eq=False, repr=False)
class Steps(Reported):
    """N recorded steps of a plant.

    states: x, (N, n)
    inputs: u, (N, m)
    disturbances: w, (N, k), as measured, with k = 0 without disturbance
    next_states: x⁺, (N, n)

    Raises BadInputError if an array has a wrong shape or contains a number that is not finite.
    """

    states: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    next_states: np.ndarray

    def __post_init__(self) -> None:
        """Check the arrays and store them."""
        for name in ("states", "inputs", "disturbances", "next_states"):
            matrix = checked_matrix(f"recorded {name}", getattr(self, name), LARGEST)
            object.__setattr__(self, name, matrix)
            if len(matrix) != len(self.states):
                raise BadInputError(
                    f"recorded {name} has {len(matrix)} rows, but states has {len(self.states)}; "
                    "give one row per step"
                )

    @property
    def together(self) -> np.ndarray:
        """Columns (x, u, w) of all steps, (N, n + m + k)."""
        return np.hstack([self.states, self.inputs, self.disturbances])


def random_steps(problem: Game, seed: int) -> Steps:
    """Return recorded steps from random states with random inputs and disturbances.

    No input or disturbance changes a state by more than the spread of the state in one problem. The
    cost of each is at most the cost of all states together.

    seed: seed of the random numbers
    """
    E = problem.E if np.isfinite(problem.delta) else problem.E[:, :0]
    spread = natural_spread(problem)
    cost = float(np.diag(problem.Q) @ spread**2) or 1.0
    widths = [spread]
    for matrix, prices in (
        (problem.B, np.diag(problem.R)),
        (E, np.full(E.shape[1], problem.delta**2)),
    ):
        reach = np.abs(matrix / spread[:, None]).max(axis=0)
        farthest = 1.0 / np.where(reach > 0.0, reach, 1.0)
        widths.append(np.minimum(farthest, np.sqrt(cost / prices)))
    sizes = np.concatenate(widths)
    count = STEPS_PER_WEIGHT * len(sizes) * (len(sizes) + 1) // 2
    together = np.random.default_rng(seed).uniform(-sizes, sizes, (count, len(sizes)))
    n, m = problem.B.shape
    states, inputs, disturbances = np.split(together, [n, n + m], axis=1)
    next_states = states @ problem.A.T + inputs @ problem.B.T + disturbances @ E.T
    return Steps(states, inputs, disturbances, next_states)


class Learned(NamedTuple):
    """Result of Q-learning.

    run: training run
    H: matrix of the final Q-function, (n + m + k, n + m + k)
    """

    run: TrainingRun
    H: np.ndarray


def learn_steps(
    problem: Game,
    seed: int = 0,
    *,
    steps: Steps | None = None,
    progress: Progress | None = None,
) -> Learned:
    """Learn the Q-function of a discrete-time game from recorded steps and the cost.

    Value iteration H <- cost + α extremum of H at x⁺ starts from 0. After 1, 3, 7, ... value
    iterations, policy iteration is tried. Learning ends if policy iteration converges to a policy
    that stabilizes the linear fit of the steps.

    seed: seed of the random steps, not used if `steps` are given
    steps: recorded steps, by default `random_steps`
    progress: called before each block of value iterations, or None

    Raises BadInputError if R is singular, or if the steps do not determine H or do not have the
    columns of the game.
    Raises NoSolutionError if the disturbance gains more than it costs, or if the iteration diverges
    or does not converge.
    """
    if not is_definite(problem.R):
        raise BadInputError(
            "R is singular: Q-learning begins with the cost of one step, which then has no minimum"
            " over u; give R > 0, or solve the game with hfa.solve"
        )
    recorded = random_steps(problem, seed) if steps is None else steps
    learner = _QLearner.of(problem, recorded)
    H = None
    iterations = 0
    rows = []
    for pause in range(PAUSES):
        if progress is not None:
            progress(pause, PAUSES, f"{iterations} iterations")
        for _ in range(2**pause):
            H = learner.value_iteration(H)
        iterations += 2**pause
        assert H is not None  # at least one iteration was made
        before = H
        rows.append((iterations, H))
        with suppress(BadInputError, np.linalg.LinAlgError):
            for _ in range(MOST_POLICIES):
                after = learner.policy_iteration(before)
                iterations += 1
                rows.append((iterations, after))
                if learner.is_settled(before, after):
                    return Learned(_training_run(learner, rows, seed), after)
                before = after
    raise NoSolutionError(
        f"Q-learning did not converge in {iterations} iterations; check with `hfa solve` that a"
        " stabilizing policy exists and that delta is large enough, or record smaller steps"
    )


class _Residual(NamedTuple):
    """Norm of the residual of Bellman's equation over all steps.

    of_cost: relative to the norm of the costs of the steps
    of_terms: relative to the norm of the sum of the absolute terms of the equation
    """

    of_cost: float
    of_terms: float


@dataclass(frozen=True, eq=False)
class _QLearner:
    """Linear equations for the Q-function H from recorded steps.

    The dimension of (x, u, w) is s = n + m + k, and H has M = s(s+1)/2 weights.

    problem: the discrete-time game
    steps: the recorded steps
    cost: weights of the cost of a step over (x, u, w), (s, s)
    scales: root mean square of each column of (x, u, w), (s,)
    features: products of the scaled columns, (N, M)
    costs: cost of each step, (N,)
    inverse: pseudoinverse of the features, (M, N)
    """

    problem: Game
    steps: Steps
    cost: np.ndarray
    scales: np.ndarray
    features: np.ndarray
    costs: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, problem: Game, steps: Steps) -> _QLearner:
        together = steps.together
        cost = q_function(problem, np.zeros_like(problem.A))
        if together.shape[1] != len(cost):
            raise BadInputError(
                f"the steps have {together.shape[1]} columns of x, u and w, but the game "
                f"requires {len(cost)}; record all columns"
            )
        scales = np.sqrt(np.mean(together**2, axis=0))
        if not scales.all():
            column = np.argmin(scales) + 1
            raise BadInputError(
                f"column {column} of the recorded (x, u, w) is 0 in every step; excite every "
                "state, input and disturbance"
            )
        features = _products(together / scales)
        refuse_poor(rank(unit_rows(features)), features.shape[1], "the recorded steps")
        costs = np.einsum("ji,ik,jk->j", together, cost, together)
        return cls(problem, steps, cost, scales, features, costs, np.linalg.pinv(features))

    @cached_property
    def psi(self) -> Basis:
        """Quadratic basis of (x, u, w), in which H has M weights."""
        return basis("quadratic", len(self.cost))

    @cached_property
    def _of_costs(self) -> np.ndarray:
        """Weights (M,) of H fitted to the costs of the steps, without the cost after them."""
        return self.inverse @ self.costs

    @cached_property
    def _of_next_states(self) -> np.ndarray:
        """Matrix (M, n(n+1)/2) from the weights of x'P x to the fitted weights of α x⁺'P x⁺."""
        return self.problem.discount * self.inverse @ _products(self.steps.next_states)

    def _H(self, weights: np.ndarray) -> np.ndarray:
        """Return the matrix H (s, s) of the given weights, over the unscaled (x, u, w)."""
        return self.psi.matrix(weights) / np.outer(self.scales, self.scales)

    def value_iteration(self, H: np.ndarray | None) -> np.ndarray:
        """Return H (s, s) after one value iteration.

        H: matrix before the iteration, or None for the first iteration

        Raises NoSolutionError if w gains more than it costs, or if the value diverges.
        """
        weights = self._of_costs
        if H is not None:
            P = of_q_function(self.problem, H)["P"]
            weights = weights + self._of_next_states @ _weights(P)
        H = self._H(weights)
        if not np.abs(H).max() <= LARGEST_CRITIC_ENTRY:
            raise NoSolutionError(
                "Q-learning diverges; check with `hfa solve` that a stabilizing policy exists"
            )
        if not self.has_saddle(H):
            raise NoSolutionError(
                f"at delta = {self.problem.delta:g}, the disturbance increases the cost "
                "without bound; choose a larger delta (`hfa solve` reports the smallest)"
            )
        return H

    def policy_iteration(self, H: np.ndarray) -> np.ndarray:
        """Return the Q-function (s, s) of the policies that are optimal for H.

        The policies are applied in all steps after the first. The weights h of the returned
        function solve h = inverse (costs + α features(x⁺) h).
        """
        parts = of_q_function(self.problem, H)
        policy = np.vstack([-parts["K"], *([parts["L"]] if "L" in parts else [])])
        after = self.steps.next_states
        moved = _products(np.hstack([after, after @ policy.T]) / self.scales)
        equations = np.eye(self.psi.size) - self.problem.discount * self.inverse @ moved
        return self._H(np.linalg.solve(equations, self._of_costs))

    def has_saddle(self, H: np.ndarray) -> bool:
        """Return whether the quadratic form of H has a minimum over u and a maximum over w."""
        n, m = self.problem.B.shape
        scaled = H * np.outer(self.scales, self.scales)
        of_inputs = np.linalg.eigvalsh(scaled[n : n + m, n : n + m])
        of_disturbances = np.linalg.eigvalsh(scaled[n + m :, n + m :])
        return bool((of_inputs > 0.0).all() and (of_disturbances < 0.0).all())

    def residual(self, H: np.ndarray) -> _Residual:
        """Return the residual of Bellman's equation for the Q-function H over all steps."""
        together = self.steps.together
        values = np.einsum("ji,ik,jk->j", together, H, together)
        moved = self.steps.next_states
        P = of_q_function(self.problem, H)["P"]
        after = self.problem.discount * np.einsum("ji,ik,jk->j", moved, P, moved)
        error = np.linalg.norm(values - self.costs - after)
        terms = np.abs(values) + np.abs(self.costs) + np.abs(after)
        return _Residual(
            float(error / np.linalg.norm(self.costs)), float(error / np.linalg.norm(terms))
        )

    def is_settled(self, before: np.ndarray, after: np.ndarray) -> bool:
        """Return whether policy iteration has converged to a stabilizing policy.

        All of these conditions must hold:

        - The block of H over the states changes by at most `SETTLED` relative to its largest entry.
        - H has a saddle point.
        - The linear fit of the steps, times √α, is stable with K, and with K and L.

        before, after: H of consecutive iterations
        """
        n, m = self.problem.B.shape
        squares = np.outer(self.scales, self.scales)
        change = np.abs((after - before) * squares)[:n, :n].max()
        size = np.abs(after * squares)[:n, :n].max()
        if not (change <= SETTLED * size and self.has_saddle(after)):
            return False
        A, B, E = np.split(self._fitted_steps(), [n, n + m], axis=1)
        policies = of_q_function(self.problem, after)
        loops = [A - B @ policies["K"]]
        if "L" in policies:
            loops.append(loops[0] + E @ policies["L"])
        root = np.sqrt(self.problem.discount)
        return all(root * np.abs(np.linalg.eigvals(loop)).max() < 1.0 for loop in loops)

    def _fitted_steps(self) -> np.ndarray:
        """Return [A B E] (n, n + m + k) of the least-squares fit x⁺ = A x + B u + E w."""
        scaled = self.steps.together / self.scales
        fit = np.linalg.lstsq(scaled, self.steps.next_states, rcond=None)[0]
        return np.asarray(fit.T / self.scales)


def _products(z: np.ndarray) -> np.ndarray:
    """Return the products z_i z_j with i <= j for each row of z (N, s), (N, s(s+1)/2)."""
    row, column = np.triu_indices(z.shape[1])
    return z[:, row] * z[:, column]


def _weights(P: np.ndarray) -> np.ndarray:
    """Return the weights W (n(n+1)/2,) with x'P x = W'(x1², x1 x2, ..., xn²)."""
    row, column = np.triu_indices(len(P))
    return np.where(row == column, 1.0, 2.0) * P[row, column]


def _training_run(learner: _QLearner, rows: list[tuple[int, np.ndarray]], seed: int) -> TrainingRun:
    """Return the record of a training run of Q-learning.

    rows: (number of iterations so far, H) after each iteration that is recorded
    seed: seed of the random steps
    """
    residuals = [learner.residual(H) for _, H in rows]
    parts = [of_q_function(learner.problem, H) for _, H in rows]
    of_cost = np.array([residual.of_cost for residual in residuals])
    return TrainingRun(
        law="Q-learning",
        basis="quadratic",
        time=np.array([float(iterations) for iterations, _ in rows]),
        weights=np.array([_weights(part["P"]) for part in parts]),
        residual_norm=of_cost,
        settling_residual=np.array([residual.of_terms for residual in residuals]),
        K=parts[-1]["K"],
        excitation=excitation(learner.features),
        seed=seed,
        names=learner.problem.names,
        clock="iterations",
        H=rows[-1][1],
    )
