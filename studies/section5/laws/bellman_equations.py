"""Bellman residuals of recorded samples as functions of the weights, in scaled coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.critic.training_run import Excitation
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.learning.recording import Stack, excitation, residual_sizes

#: Largest number of refinement steps; each squares the error until it reaches rounding.
MOST_REFINEMENTS = 20


class PartialGame(NamedTuple):
    """Auxiliary game between the discounted LQ problem (share 0) and the final game (discount 0,
    share 1).

    discount: β >= 0, 1/s
    share: s in [0, 1], the fraction of the final 1/δ²
    """

    discount: float
    share: float


#: The LQ problem without discount, and the game itself.
LQ = PartialGame(0.0, 0.0)
GAME = PartialGame(0.0, 1.0)


class Residuals(NamedTuple):
    """Bellman residuals of the recorded samples for given weights.

    regressors: σ_j, (N_h, M)
    residuals: e_j, (N_h,)
    size: sum of the magnitudes of the terms of e_j, (N_h,)
    """

    regressors: np.ndarray
    residuals: np.ndarray
    size: np.ndarray

    @property
    def relative(self) -> float:
        """Norm of the residuals divided by the norm of `size`."""
        return float(np.linalg.norm(self.residuals) / np.linalg.norm(self.size))


@dataclass(frozen=True, eq=False)
class StackEquations:
    """Bellman residuals e_j(W) of recorded samples, in the coordinates y = z / scales.

    e_j(W) = W'σ_j + z_j'Q z_j + z_j'P S_s P z_j
    σ_j = ∂ψ_j (F_j - β z_j - S_s P z_j)
    S_s = S_u - s S_d/δ²

    P is the quadratic part of W. The extremal policies of P are u = -R⁻¹B'P z and
    d = s δ⁻²E'P z. For a quadratic basis e_j is the paper's residual (Eq. 32-34), with the policies
    evaluated again at the recorded states, and ∂e_j/∂W = σ_j. F_j - β z_j is the drift of the
    discounted plant A - βI. With β = 0 and s = 1 the residuals are those of the game.

    basis: ψ, basis of the value
    scales: (n,), scales of the states
    states, drifts: z_j and F_j, (N_h, n), scaled
    gradient: ∂ψ_j, (N_h, M, n)
    control: G, (n, m), with S_u = G G'. If a few inputs stabilize a plant with a large P, P S_u P
        is a small difference of large numbers, but |G'P z|² is not.
    disturbance: (n, k), a square root of S_d/δ²
    Q: (n, n), scaled
    drift_matrix: (n, n), A fitted to F = A z by least squares, used only to test whether a policy
        stabilizes
    """

    basis: Basis
    scales: np.ndarray
    states: np.ndarray
    drifts: np.ndarray
    gradient: np.ndarray
    control: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray
    drift_matrix: np.ndarray

    @classmethod
    def build(cls, game: Game, basis: Basis, stack: Stack, scales: np.ndarray) -> StackEquations:
        """Return the equations of recorded samples of a game.

        The equations contain B, E, Q, R, N and δ of the game, but not A. With cross weights N, they
        are those of the input v = u + R⁻¹N'z: the drifts are F_j - B R⁻¹N'z_j.

        basis: ψ, basis of the value
        stack: recorded states and drifts
        scales: (n,), scales of the states
        """
        states = stack.states / scales
        drifts = (stack.drifts - stack.states @ (game.B @ game.F).T) / scales
        outer = np.outer(scales, scales)
        return cls(
            basis=basis,
            scales=scales,
            states=states,
            drifts=drifts,
            gradient=basis.gradient(states),
            control=control_root(game) / scales[:, None],
            disturbance=game.E / game.delta / scales[:, None],
            Q=game.without_cross_weights.Q * outer,
            drift_matrix=Stack(states, drifts).drift_fit(),
        )

    @property
    def excitation(self) -> Excitation:
        """The rank and the condition of the recorded samples."""
        return excitation(self.basis.psi(self.states))

    def at(self, weights: np.ndarray, problem: PartialGame) -> Residuals:
        """Return the regressors and residuals of all samples for given weights.

        The last result is cached. Therefore the weights must not be changed in place.

        weights: (M,), scaled
        problem: discount and share
        """
        last_weights, last_problem, last_residuals = self._last
        if last_weights is weights and last_problem == problem:
            return last_residuals
        pushed, policy_cost = self._policies(self.states @ self.basis.matrix(weights), problem)
        regressors = self.along(self.drifts - problem.discount * self.states - pushed)
        change = regressors @ weights
        cost = self.state_cost
        residuals = Residuals(
            regressors, change + cost + policy_cost, np.abs(change) + cost + np.abs(policy_cost)
        )
        self._last[:] = weights, problem, residuals
        return residuals

    @cached_property
    def _last(self) -> list[Any]:
        """Cache of `at`: the weights, the problem and the result of the last call, each None at
        first.
        """
        return [None, None, None]

    @cached_property
    def state_cost(self) -> np.ndarray:
        """State cost z_j'Q z_j of each sample, (N_h,)."""
        return np.asarray(np.einsum("ji,ji->j", self.states @ self.Q, self.states))

    def _policies(
        self, half_gradient: np.ndarray, problem: PartialGame
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return S_s ½∇V, (N_h, n), and ½∇V' S_s ½∇V, (N_h,), at the recorded states.

        The first array is the reduction of the state's rate by the two extremal policies. The
        second array is the cost rate of these policies.

        half_gradient: ½∇V, (N_h, n)
        problem: discount and share
        """
        inputs = half_gradient @ self.control
        pushed = inputs @ self.control.T
        cost = _squares(inputs)
        if problem.share == 0.0:
            return pushed, cost
        gusts = half_gradient @ self.disturbance
        return pushed - problem.share * (
            gusts @ self.disturbance.T
        ), cost - problem.share * _squares(gusts)

    def along_step(
        self, weights: np.ndarray, step: np.ndarray, found: Residuals, problem: PartialGame
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients l and q of the residuals along a step, (N_h,) each.

        e_j(W - f N) = e_j(W) + f l_j + f² q_j holds without approximation. For a quadratic basis l
        = -σN and q_j = -(P_N z_j)' S_s (P_N z_j), where P_N is the matrix of N.

        weights: W, (M,), scaled
        step: N, (M,)
        found: residuals at W
        problem: discount and share
        """
        pushed, policy_cost = self._policies(self.states @ self.basis.matrix(step), problem)
        linear = -found.regressors @ step
        quadratic = -policy_cost
        beyond = slice(self.basis.quadratic_size, None)
        if self.basis.size > self.basis.quadratic_size:
            change = self.along(pushed)[:, beyond]
            linear = linear + change @ weights[beyond]
            quadratic = quadratic - change @ step[beyond]
        return linear, quadratic

    def along(self, rates: np.ndarray) -> np.ndarray:
        """Return the rates of the basis functions at the recorded states, ∂ψ_j rates_j, (N_h, M).

        rates: rates of the state at the recorded states, (N_h, n)
        """
        product: np.ndarray = (self.gradient @ rates[:, :, None])[..., 0]
        return product

    def closed_loop_eigenvalues(self, weights: np.ndarray, problem: PartialGame) -> np.ndarray:
        """Return the eigenvalues of the closed loop A - βI - S_s P, (n,), 1/s.

        A is fitted to the recorded drifts.

        weights: (M,), scaled, of the value with the quadratic part P
        problem: discount and share
        """
        pushed, _ = self._policies(self.basis.matrix(weights), problem)
        return np.linalg.eigvals(self.drift_matrix - pushed.T) - problem.discount

    def margin(self, weights: np.ndarray, problem: PartialGame) -> float:
        """Return the stability margin of the closed loop, 1/s, positive for a stable loop.

        The margin is the negative of the largest real part of `closed_loop_eigenvalues`.

        weights, problem: as for `closed_loop_eigenvalues`
        """
        return -float(self.closed_loop_eigenvalues(weights, problem).real.max())

    def scaled(self, weights: np.ndarray) -> np.ndarray:
        """Return the weights of the same value in the scaled coordinates y = z / scales.

        weights: (M,), in the model's coordinates z
        """
        return weights * self._scaling

    def unscaled(self, weights: np.ndarray) -> np.ndarray:
        """Return the weights of the same value in the model's coordinates z.

        weights: (M,), in the scaled coordinates y = z / scales
        """
        return weights / self._scaling

    @cached_property
    def _scaling(self) -> np.ndarray:
        return self.basis.scaling(self.scales)

    def reported_residuals(self, weights: np.ndarray) -> dict[str, float]:
        """Return two relative norms of the residual e of the game's Hamilton-Jacobi-Isaacs
        equation.

        At sample j, e_j = ∇V'F_j + z_j'Q z_j - ¼ ∇V' S ∇V with ∇V = ∂ψ_j'W and S = S_s for s = 1
        (paper Eq. 33 with the extremal policies).

        residual_norm: |e| divided by |z'Qz|
        settling_residual: |e| divided by the norm of the summed magnitudes of the terms of e, in
            [0, 1]

        weights: W, (M,), scaled
        """
        slopes = np.einsum("jmi,m->ji", self.gradient, weights)
        S = self.control @ self.control.T - self.disturbance @ self.disturbance.T
        of_cost, of_terms = residual_sizes(slopes, self.drifts, self.state_cost, S)
        return {"residual_norm": of_cost, "settling_residual": of_terms}


def _squares(rows: np.ndarray) -> np.ndarray:
    """Return the squared Euclidean norm of each row of a matrix."""
    return np.asarray(np.einsum("ji,ji->j", rows, rows))


def control_root(game: Game) -> np.ndarray:
    """Return a matrix G, (n, m), with G G' = B R⁻¹B' of a game."""
    root: np.ndarray = np.linalg.solve(np.linalg.cholesky(game.R), game.B.T).T
    return root


def newton_step(found: Residuals, normaliser: np.ndarray) -> np.ndarray:
    """Return the Newton step N, (M,), the least-squares solution of σ̄ N = ē, σ̄ = σ/n and ē = e/n.

    W - N is the result of a full step of policy iteration. No singular values are dropped. Near the
    limit of stability σ̄ is nearly singular, and a tolerance would drop the decisive direction.

    found: regressors σ and residuals e at W
    normaliser: normalization n, (N_h,)

    Raises numpy.linalg.LinAlgError if σ̄ is singular.
    """
    from scipy.linalg.lapack import dtrtrs

    size = found.regressors.shape[1]
    both = np.column_stack([found.regressors, found.residuals]) / normaliser[:, None]
    # R is on and above the diagonal, and Q'ē is the last column.
    factored = np.linalg.qr(both, mode="raw")[0].T
    step, failed = dtrtrs(factored[:size, :size], factored[:size, size])
    if failed:
        raise np.linalg.LinAlgError("the regressors are singular")
    return np.asarray(step)


class Riccati(NamedTuple):
    """Riccati equation A'P + PA + Q - PSP = 0, with S = G G' - D D' and A fitted to recorded
    drifts.

    A: (n, n), fitted to the drifts
    control: G, (n, m)
    disturbance: D, (n, k)
    Q: (n, n)

    P S P is computed from G'P and D'P. If a few inputs stabilize a plant with a large P, S P is a
    small difference of large numbers, but G'P is not.
    """

    A: np.ndarray
    control: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray

    def residual(self, P: np.ndarray) -> np.ndarray:
        """Return the residual A'P + PA + Q - PSP of the Riccati equation, (n, n)."""
        pushed = P @ self.control
        disturbed = P @ self.disturbance
        return self.A.T @ P + P @ self.A + self.Q - pushed @ pushed.T + disturbed @ disturbed.T

    def correction(self, P: np.ndarray) -> np.ndarray:
        """Return the Newton correction N, (n, n), with (A - S P)'N + N (A - S P) = `residual`.

        P - N is the next iterate of policy iteration.

        Raises numpy.linalg.LinAlgError if the equation of N is singular.
        """
        closed = (
            self.A
            - self.control @ (self.control.T @ P)
            + self.disturbance @ (self.disturbance.T @ P)
        )
        eye = np.eye(len(P))
        operator = np.kron(closed.T, eye) + np.kron(eye, closed.T)
        step = np.linalg.solve(operator, self.residual(P).reshape(-1)).reshape(P.shape)
        return np.asarray(step + step.T) / 2.0

    def refined(self, P: np.ndarray) -> np.ndarray:
        """Return P after at most `MOST_REFINEMENTS` Newton corrections P <- P - N.

        The corrections end when a correction is not smaller than half of the one before, or when
        the equation of N is singular.
        """
        last = np.inf
        for _ in range(MOST_REFINEMENTS):
            try:
                correction = self.correction(P)
            except np.linalg.LinAlgError:
                break
            size = float(np.linalg.norm(correction))
            if not size < 0.5 * last:
                break
            P = P - correction
            last = size
        return P
