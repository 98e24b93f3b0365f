"""Bellman residual of every recorded sample as a function of the weights, in scaled coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from controller.game.basis import Basis
from controller.game.training_run import Excitation
from controller.game.zero_sum import Game
from controller.learning.recording import Stack, excitation

#: Most steps of a refinement; each squares the error until rounding stops it.
MOST_REFINEMENTS = 20


class PartialGame(NamedTuple):
    """Auxiliary game on the way to the final one.

    discount: β >= 0, 1/s
    share: s in [0, 1], the share of the final 1/δ²
    """

    discount: float
    share: float


#: The LQ problem without discount, and the game itself.
LQ = PartialGame(0.0, 0.0)
GAME = PartialGame(0.0, 1.0)


class Residuals(NamedTuple):
    """Bellman residuals of a stack at given weights.

    regressors: σ_j, (N_h, M)
    residuals: e_j, (N_h,)
    size: sum of the magnitudes of the terms of e_j, (N_h,)
    """

    regressors: np.ndarray
    residuals: np.ndarray
    size: np.ndarray

    @property
    def relative(self) -> float:
        """|e| divided by the size of the terms that cancel in it."""
        return float(np.linalg.norm(self.residuals) / np.linalg.norm(self.size))


@dataclass(frozen=True, eq=False)
class StackEquations:
    """Bellman residuals e_j(W) of a recorded stack, in the coordinates y = z / scales.

    e_j(W) = W'σ_j + z_j'Q z_j + z_j'P S_s P z_j,  σ_j = ∂ψ_j (F_j - β z_j - S_s P z_j),
    S_s = S_u - s S_d/δ².

    P is the quadratic part of W. Its extremal policies are u = -R⁻¹B'P z and d = s δ⁻²E'P z, so
    that for a quadratic basis this is the paper's residual (Eq. 32-34) with policies re-evaluated
    at the stored states, and ∂e_j/∂W = σ_j. F_j - β z_j is the drift of the discounted plant A -
    βI. β = 0, s = 1 is the game itself.

    control: G, (n, m), with S_u = G G'. Where few inputs hold a large P in check, P S_u P is a
        small difference of large numbers and |G'P z|² is not.
    disturbance: (n, k), the root of S_d/δ²
    drift_matrix: least-squares fit of F = A z to the stack, used only to test whether a policy
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
        """Return the equations of a stack. Of the game only B, E, Q, R and δ are read, never A."""
        states = stack.states / scales
        drifts = stack.drifts / scales
        outer = np.outer(scales, scales)
        return cls(
            basis=basis,
            scales=scales,
            states=states,
            drifts=drifts,
            gradient=basis.gradient(states),
            control=control_root(game) / scales[:, None],
            disturbance=game.E / game.delta / scales[:, None],
            Q=game.Q * outer,
            drift_matrix=Stack(states, drifts).drift_fit(),
        )

    def excitation(self, weights: np.ndarray) -> Excitation:
        """Return the richness of the stack at scaled weights (M,), with the policies of the
        game."""
        with np.errstate(over="ignore"):  # regressors that overflow when squared count as nothing
            return excitation(self.at(weights, GAME).regressors, self.basis.psi(self.states))

    def at(self, weights: np.ndarray, problem: PartialGame) -> Residuals:
        """Return the regressors and residuals of all samples at scaled weights (M,).

        The last result is cached, because a law uses the same weights several times a tick; so the
        weights must not be changed in place.
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
        """Weights, problem and result of the last call of `at`."""
        return [None, None, None]

    @cached_property
    def state_cost(self) -> np.ndarray:
        """State cost z_j'Q z_j, (N_h,)."""
        return np.asarray(np.einsum("ji,ji->j", self.states @ self.Q, self.states))

    def _policies(
        self, half_gradient: np.ndarray, problem: PartialGame
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the effect of both extremal policies on the state, and their cost.

        They are S_s ½∇V, (N_h, n), and ½∇V' S_s ½∇V, (N_h,).

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
        """Return l and q, (N_h,) each, of the exact e_j(W - f N) = e_j(W) + f l_j + f² q_j.

        For a quadratic basis l = -σN and q_j = -(P_N z_j)' S_s (P_N z_j).

        weights: W, scaled
        step: N
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
        """Return the derivatives of ψ_j along given rates of the state, ∂ψ_j rates_j, (N_h, M).

        rates: (N_h, n)
        """
        product: np.ndarray = (self.gradient @ rates[:, :, None])[..., 0]
        return product

    def closed_loop_eigenvalues(self, weights: np.ndarray, problem: PartialGame) -> np.ndarray:
        """Return the eigenvalues of A - βI - S_s P with A fitted to the stack, (n,), 1/s."""
        pushed, _ = self._policies(self.basis.matrix(weights), problem)
        return np.linalg.eigvals(self.drift_matrix - pushed.T) - problem.discount

    def margin(self, weights: np.ndarray, problem: PartialGame) -> float:
        """Return the distance of the closed-loop eigenvalues from the imaginary axis, 1/s.

        It is positive for a stable loop.
        """
        return -float(self.closed_loop_eigenvalues(weights, problem).real.max())

    def scaled(self, weights: np.ndarray) -> np.ndarray:
        """Return weights for y = z / scales from weights for the model's coordinates z."""
        return weights * self._scaling

    def unscaled(self, weights: np.ndarray) -> np.ndarray:
        """Return weights for the model's coordinates z from weights for y = z / scales."""
        return weights / self._scaling

    @cached_property
    def _scaling(self) -> np.ndarray:
        return self.basis.scaling(self.scales)

    def reported_residuals(self, weights: np.ndarray) -> dict[str, float]:
        """Return the reported norms of the residual e of the game's Hamilton-Jacobi-Isaacs
        equation.

        e_j = ∇V'F_j + z'Qz - ¼ ∇V' S ∇V with ∇V = ∂ψ'W (paper Eq. 33 with the extremal policies).

        residual_norm: |e| divided by |z'Qz|
        settling_residual: |e| divided by the size of the terms that cancel in e, in [0, 1]. It
            decides whether a critic has settled, because relative to z'Qz alone rounding would
            exceed the limit where Q is small compared with the value.
        """
        gradient = np.einsum("jmi,m->ji", self.gradient, weights)
        change = gradient * self.drifts
        cost = self.state_cost
        _, policy_cost = self._policies(0.5 * gradient, GAME)
        norm = float(np.linalg.norm(change.sum(axis=1) + cost - policy_cost))
        size = np.abs(change).sum(axis=1) + cost + np.abs(policy_cost)
        return {
            "residual_norm": norm / float(np.linalg.norm(cost)),
            "settling_residual": norm / float(np.linalg.norm(size)),
        }


def _squares(rows: np.ndarray) -> np.ndarray:
    """Return |row|² for each row."""
    return np.asarray(np.einsum("ji,ji->j", rows, rows))


def control_root(game: Game) -> np.ndarray:
    """Return G with G G' = B R⁻¹B', (n, m)."""
    root: np.ndarray = np.linalg.solve(np.linalg.cholesky(game.R), game.B.T).T
    return root


def newton_step(found: Residuals, normaliser: np.ndarray) -> np.ndarray:
    """Return N with σ̄ N = ē in the least-squares sense, (M,); W - N is the full policy-iteration
    step.

    σ̄ = σ/n and ē = e/n are solved by QR of (σ̄, ē) without dropping singular values. Near the
    limit of stability σ̄ is nearly singular, and a pseudo-inverse with a tolerance would drop the
    decisive direction. Raises numpy.linalg.LinAlgError when σ̄ is singular.

    found: regressors σ and residuals e
    normaliser: n, (N_h,)
    """
    from scipy.linalg.lapack import dtrtrs

    size = found.regressors.shape[1]
    both = np.column_stack([found.regressors, found.residuals]) / normaliser[:, None]
    # R on and above its diagonal, and Q'ē in its last column.
    factored = np.linalg.qr(both, mode="raw")[0].T
    step, failed = dtrtrs(factored[:size, :size], factored[:size, size])
    if failed:
        raise np.linalg.LinAlgError("the regressors are singular")
    return np.asarray(step)


class Riccati(NamedTuple):
    """Riccati equation A'P + PA + Q - PSP = 0 with S = G G' - D D', from recorded drifts.

    A: (n, n), fitted to the drifts
    control: G, (n, m)
    disturbance: D, (n, k)
    Q: (n, n)

    P S P is computed from its roots. Where few inputs stabilize a plant with a large P, S P is a
    small difference of large numbers, unlike |G'P|.
    """

    A: np.ndarray
    control: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray

    def residual(self, P: np.ndarray) -> np.ndarray:
        """Return A'P + PA + Q - PSP, (n, n)."""
        pushed = P @ self.control
        disturbed = P @ self.disturbance
        return self.A.T @ P + P @ self.A + self.Q - pushed @ pushed.T + disturbed @ disturbed.T

    def correction(self, P: np.ndarray) -> np.ndarray:
        """Return N, (n, n), with (A - S P)'N + N (A - S P) = `residual`; P - N is the next policy
        iteration.

        It is the solution of n² linear equations. Raises numpy.linalg.LinAlgError when they are
        singular.
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
        """Return P after corrections P <- P - N, repeated until they no longer halve (rounding)."""
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
