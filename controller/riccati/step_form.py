"""A game in discrete time, in the coordinates in which it is solved: no discount and δ = 1."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from controller.game.zero_sum import least_scaled_eigenvalue
from controller.riccati.balancing import largest, largest_or_1
from controller.riccati.double_double import exact, product_of_doubles
from controller.riccati.form import (
    LAST,
    RESIDUAL,
    UNPAID,
    Answer,
    Form,
    doubled,
)
from controller.riccati.lyapunov import Lyapunov
from hfa_support.errors import NoSolutionError
from hfa_support.reporting.checks import Check, at_least, at_most

#: Lower bound of the smallest eigenvalue of I - E'X E.
SADDLE = 1e-12


@dataclass(frozen=True, eq=False)
class StepForm(Form):
    """Game y⁺ = A y + B v + E w in discrete time with δ = 1.

      X = Q + A'X A - (A'X G + M)(W + G'X G)⁻¹(G'X A + M')

    with G = [B E], W = blkdiag(R, -I) and M = [N 0].

    R may be singular: the solution only needs R + B'X B > 0.
    """

    is_discrete = True
    equation = "Bellman's equation"
    of_matrix = " of sqrt(discount) A"
    loop_words = ("sqrt(discount) (A - B K + E L)", "sqrt(discount) (A - B K)")

    def without_cross_weights(self) -> Self:
        """Return the game itself: R may be singular, so that cross weights stay."""
        return self

    def effect(self) -> np.ndarray:
        """Return B price⁺ B', (n, n)."""
        return self.inputs @ _inverse(self.price) @ self.inputs.T

    @property
    def price(self) -> np.ndarray:
        """R + B'Q B, (m, m)."""
        return self.R + self.inputs.T @ self.Q @ self.inputs

    @cached_property
    def G(self) -> np.ndarray:
        """[B E], (n, m + k)."""
        return np.hstack([self.inputs, self.E])

    @cached_property
    def W(self) -> np.ndarray:
        """blkdiag(R, -I), (m + k, m + k)."""
        W = -np.eye(self.G.shape[1])
        W[: len(self.R)] = 0.0
        W[: len(self.R), : len(self.R)] = self.R
        return W

    @cached_property
    def M(self) -> np.ndarray:
        """[N 0], (n, m + k)."""
        return np.hstack([self.N, np.zeros_like(self.E)])

    def gains(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of v = -K y and w = L y, the policies of the value y'X y."""
        K, minus_L = np.split(self._both_gains(X), [len(self.R)])
        return K, -minus_L / self.delta

    def _both_gains(self, X: np.ndarray) -> np.ndarray:
        """Return [K; -δ L] = (W + G'X G)⁻¹(G'X A + M'), (m + k, n)."""
        GX = self.G.T @ X
        return np.linalg.solve(self.W + GX @ self.G, GX @ self.A + self.M.T)

    def _residual(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual of X in twice the precision, and the loop A - G [K; -δ L], (n, n).

        The residual is that of the cost of both policies. Their errors affect it to second order.
        """
        gains = self._both_gains(X)
        loop = exact(self.A) + product_of_doubles(-self.G, gains)
        crossed = product_of_doubles(-self.M, gains)
        paid = product_of_doubles(gains.T, self.W) @ exact(gains) + (crossed + crossed.mT)
        after = loop.mT @ (exact(X) @ loop)
        residual = ((exact(self.Q) + paid) + (exact(-X) + after)).high
        return (residual + residual.T) / 2.0, loop.high

    def relative_residual(self, X: np.ndarray) -> float:
        """Return the largest residual of Bellman's equation for X relative to its terms.

        The terms are |Q|, |N K|, |K'R K|, |X| and |A - B K|'|X||A - B K|, entry by entry. The
        residual is nan if X has no policies.
        """
        X = (X + X.T) / 2.0
        try:
            residual, _ = self._residual(X)
        except np.linalg.LinAlgError:
            return math.nan
        K, _ = self.gains(X)
        loop = np.abs(self.A - self.inputs @ K)
        terms = np.abs(self.Q) + np.abs(K.T @ self.R @ K) + np.abs(X) + loop.T @ np.abs(X) @ loop
        terms += np.abs(self.N @ K)
        return largest(residual) / (float(terms.max()) or 1.0)

    def newton_step(self, X: np.ndarray) -> np.ndarray:
        """Return the Newton correction Z, (n, n): Z = F'Z F + residual(X), F the loop of X.

        Raises NoSolutionError if this equation is singular within rounding.
        """
        with _no_singularity():
            residual, loop = self._residual(X)
            return Lyapunov.of_steps(loop).solve(-residual)[0]

    def unrefined(self) -> np.ndarray:
        """Return X, (n, n), from the stable subspace of the extended symplectic pencil.

        Source: Van Dooren, SIAM J. Scientific and Statistical Computing 2 (1981), 121-135.

        Raises NoSolutionError if the subspace does not have dimension n or is not a graph.
        """
        from scipy.linalg import ordqz

        n = len(self.A)
        size = self.G.shape[1]
        one, zero = np.eye(n), np.zeros((n, n))
        no_states = np.zeros((size, n))
        left = np.block(
            [
                [self.A, zero, self.G],
                [-self.Q, one, -self.M],
                [self.M.T, no_states, self.W],
            ]
        )
        right = np.block([[one, zero], [zero, self.A.T], [no_states, -self.G.T]])
        # Combinations of the equations without the inputs [v; w] form a pencil of size 2n.
        of_inputs = left[:, 2 * n :]
        without_inputs = np.linalg.qr(of_inputs, mode="complete").Q[:, size:].T
        pencil = without_inputs @ left[:, : 2 * n], without_inputs @ right
        with _no_singularity():
            _, _, alpha, beta, _, basis = ordqz(*pencil, sort="iuc", output="real")
            if np.sum(np.abs(alpha) < np.abs(beta)) != n:
                raise NoSolutionError("the pencil has eigenvalues on the unit circle")
            states, costates = np.split(basis[:, :n], 2)
            return np.linalg.solve(states.T, costates.T)  # costates = X states, X symmetric

    def by_doubling(self) -> np.ndarray:
        """Return X as the limit of the costs over 2^k steps, with the cost p I of the final state.

        X = p I + Y, and the first step with the final cost p I gives a game of Y without R
        (`doubled`).

        Source: Chu, Fan, Lin and Wang, Int. J. Control 77 (2004).
        """
        one = np.eye(len(self.A))
        G = self.G
        with _no_singularity():
            weights = self.W + LAST * G.T @ G
            crossed = LAST * G.T @ self.A + self.M.T
            gains = np.linalg.solve(weights, crossed)
            A = self.A - G @ gains
            Y = self.Q + LAST * (self.A.T @ self.A - one) - crossed.T @ gains
            S = G @ np.linalg.solve(weights, G.T)
            with np.errstate(all="ignore"):
                Y = doubled(A, S, Y)
        return Y + LAST * one

    def axis_checks(self) -> tuple[Check, ...]:
        """Return no checks: `unrefined` counts the eigenvalues inside the unit circle."""
        return ()

    def loops(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return A - G [K; -δ L] and A - B K, (n, n)."""
        with _no_singularity():
            K, _ = self.gains(X)
            _, game_loop = self._residual(X)
        return game_loop, self.A - self.inputs @ K

    def more_checks(self, X: np.ndarray) -> tuple[Check, ...]:
        """Return the checks of a Newton step, and that both players pay for what they do."""
        error = largest(self.newton_step(X)) / largest_or_1(X)
        paid = _least(np.eye(self.E.shape[1]) - self.E.T @ X @ self.E)
        price = self.R + self.inputs.T @ X @ self.inputs
        prices = np.diag(price)
        paid_for = prices.min() > UNPAID * prices.max()
        weight = least_scaled_eigenvalue(price) if paid_for else 0.0
        inexact = f"a Newton step changes P by {error:.2g}"
        unpaid = "delta^2 I - discount E'P E is not positive definite"
        free = "R + discount B'P B is not positive definite"
        return (
            at_most("newton_correction", error, RESIDUAL, inexact),
            at_least("disturbance_pays", paid, SADDLE, unpaid),
            at_least("input_pays", weight, 10.0 * len(price) * np.finfo(float).eps, free),
        )

    def existence(self) -> Answer:
        """Return whether the game has a value at this delta, by the checks of its X."""
        try:
            form, X, _ = self.levelled()
            checks = form.checks(form.refined(X))
        except NoSolutionError as failure:
            return Answer(False, str(failure))
        failed = [
            each.reason for each in checks if not each.ok and each.name != "newton_correction"
        ]
        return Answer(False, failed[0]) if failed else Answer(True)

    @property
    def without_input(self) -> tuple[np.ndarray, np.ndarray]:
        """A - B R⁺ N' and Q - N R⁺ N'."""
        F = _inverse(self.R) @ self.N.T
        return self.A - self.inputs @ F, self.Q - self.N @ F

    @property
    def reach(self) -> np.ndarray:
        """B, (n, m)."""
        return self.inputs

    def beyond(self, value: complex) -> tuple[float, complex]:
        """Return |λ| - 1, and λ / |λ|."""
        size = abs(value)
        return size - 1.0, value / (size or 1.0)


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of a symmetric matrix, (m, m), or its pseudoinverse if it is singular."""
    return np.linalg.pinv(matrix, rcond=SADDLE, hermitian=True)


def _least(matrix: np.ndarray) -> float:
    """Return the smallest eigenvalue of the symmetric part of a matrix, inf without entries."""
    return float(np.linalg.eigvalsh((matrix + matrix.T) / 2.0).min(initial=math.inf))


@contextmanager
def _no_singularity() -> Iterator[None]:
    """Raise NoSolutionError where linear algebra meets a singular or an infinite matrix."""
    try:
        yield
    except (np.linalg.LinAlgError, ValueError) as error:
        raise NoSolutionError(f"the computation fails: {error}") from error
