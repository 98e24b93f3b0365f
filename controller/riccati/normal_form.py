"""Normal form of a game, which every solver uses: balanced units of the state, R = I, δ = 1."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple, Self

import numpy as np

from controller.game.zero_sum import Game, is_semidefinite
from controller.riccati.balancing import hamiltonian, largest, largest_or_1, units_of
from controller.riccati.double_double import (
    Pair,
    add,
    exact,
    product,
    product_of_doubles,
    remainder,
    transposed,
)
from controller.riccati.frequency_response import scaled_root


def stable_basis(matrix: np.ndarray) -> np.ndarray | None:
    """Return an orthonormal basis (2n, n) of the stable subspace of a Hamiltonian.

    The result is None if the dimension of the subspace is not n or the Schur form fails.
    """
    return ordered_basis(matrix, job=b"N")[0]


def ordered_basis(matrix: np.ndarray, job: bytes) -> tuple[np.ndarray | None, float]:
    """Return an orthonormal basis (2n, n) of the stable subspace of a matrix, and a separation.

    The basis is None if the dimension of the subspace is not n, or if the Schur form fails. The
    separation is that of the stable and unstable blocks of the Schur form.

    matrix: (2n, 2n)
    job: LAPACK job, b"N" for the basis alone, b"V" to compute the separation too
    """
    from scipy.linalg.lapack import dgees, dtrsen

    half = len(matrix) // 2
    form, _, growth, _, basis, _, failed = dgees(lambda *_: 0, matrix)  # unsorted
    if failed:
        return None, 0.0
    size = max(1, 2 * half * half)
    _, basis, growth, _, _, _, separation, failed = dtrsen(
        growth < 0.0, form, basis, job=job, lwork=size, liwork=size
    )
    stable_first = np.array_equal(growth < 0.0, np.arange(2 * half) < half)
    return (basis[:, :half] if stable_first and not failed else None), float(separation)


#: A cosine below this belongs to a P above its inverse, in balanced units.
MODERATE = 1e-4
#: Relative change of A below which a matrix counts as rank-deficient. A mode with a smaller reach
#: is not reached.
RANK = 1e-13
#: Smallest number with full precision; smaller numbers count as 0.
FAINT = float(np.finfo(float).tiny)
#: Relative change of a Hamiltonian by rounding in its Schur form, for n up to some hundred states.
BACKWARD = 32.0 * float(np.finfo(float).eps)


class Sizes(NamedTuple):
    """Magnitudes of the terms whose sums are the entries of A, B, E and Q of a game.

    The rounding error of a sum is relative to the sum of the magnitudes of its terms, even if the
    terms cancel. These magnitudes therefore bound the rounding in the matrices.

    A: (n, n)
    B: (n, m), with R = I
    E: (n, k)
    Q: (n, n)
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    Q: np.ndarray

    def in_coordinates(self, T: np.ndarray, inverse: np.ndarray) -> Sizes:
        """Return the magnitudes of the terms in the coordinates y = T z.

        T: (n, n)
        inverse: T⁻¹, (n, n)
        """
        into = np.abs(T)
        back = np.abs(inverse)
        return Sizes(into @ self.A @ back, into @ self.B, into @ self.E, back.T @ self.Q @ back)


@dataclass(frozen=True, eq=False)
class NormalForm:
    """Game in coordinates y = T z of the state, with R = I and δ = 1: A'X + X A + Q - X S X = 0.

    S is B B' - E E'. The form describes one game, or a stack of games with the same R and delta.

    A: (..., n, n)
    inputs: (..., n, m), B of the game in y, before the scaling to R = I; stored because rounding of
        the scaled B would hide a mode that the inputs barely reach
    disturbance: (..., n, k), E of the game in y, before division by delta
    Q: (..., n, n)
    T: (..., n, n); the P of a game is T'X T
    root: (m, m), lower triangular, R = root root'
    delta: delta of the games
    R: (m, m), R of the user
    made_of: magnitudes of the terms of the matrices of one game, or None if the matrices were given
    F: (m, n), R⁻¹ N' of a game with cross weights in the user's coordinates, or None for N = 0. A
        and Q of the form belong to the input v = u + F z.
    """

    A: np.ndarray
    inputs: np.ndarray
    disturbance: np.ndarray
    Q: np.ndarray
    T: np.ndarray
    root: np.ndarray
    delta: float
    R: np.ndarray
    made_of: Sizes | None = field(default=None, kw_only=True)
    F: np.ndarray | None = field(default=None, kw_only=True)

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, game: Game) -> NormalForm:
        """Return the normal form of one game, cached for each game."""
        return cls.of_plants(game.A, game.B, game)

    @classmethod
    def of_plants(cls, A: np.ndarray, B: np.ndarray, like: Game) -> NormalForm:
        """Return the normal form of games with different A and B, in balanced units of the states.

        Entries too small for products with correct digits become 0 (`without_faint`). Cross weights
        are eliminated (`Game.without_cross_weights`).

        Source of the scaling by R^-½: Zhou, Doyle and Glover, Section 14.1.

        A: (..., n, n)
        B: (..., n, m)
        like: game with E, Q, R, N and delta of all games
        """
        root = np.linalg.cholesky(like.R)
        F = like.F if like.N.any() else None
        plain_A = A if F is None else A - B @ F
        plain_Q = like.without_cross_weights.Q
        given_A = A
        A = without_faint(plain_A, FAINT)
        B = without_faint(B, FAINT**0.5)
        scaled_B = np.linalg.solve(root, B.mT).mT
        disturbance = without_faint(like.E, FAINT**0.5)
        E = disturbance / like.delta
        Q = without_faint((plain_Q + plain_Q.T) / 2.0, FAINT)
        units = units_of(A, scaled_B @ scaled_B.mT - E @ E.T, np.broadcast_to(Q, A.shape))
        rows = units[..., None]
        columns = units[..., None, :]
        form = cls(
            A=A * columns / rows,
            inputs=B / rows,
            disturbance=disturbance / rows,
            Q=Q * rows * columns,
            T=np.eye(A.shape[-1]) / rows,
            root=root,
            delta=like.delta,
            R=like.R,
            F=F,
        )
        vars(form)["B"] = scaled_B / rows  # cached; also used for parts of a stack
        if F is None or A.ndim > 2:
            return form
        A_size = np.abs(given_A) + np.abs(B) @ np.abs(F)
        Q_size = np.abs(like.Q) + np.abs(like.N) @ np.abs(F)
        in_user_units = Sizes(A_size, np.abs(scaled_B), np.abs(disturbance), Q_size)
        return replace(form, made_of=in_user_units.in_coordinates(form.T, np.diag(units)))

    def __getitem__(self, index: int | np.ndarray | None) -> NormalForm:
        """Return one game of a stack, or the stack of several selected games.

        index: an integer, an array of indices or a mask; None returns one game as a stack of one
        """
        part = replace(
            self,
            A=self.A[index],
            inputs=self.inputs[index],
            disturbance=self.disturbance[index],
            Q=self.Q[index],
            T=self.T[index],
        )
        vars(part)["B"] = self.B[index]
        return part

    def with_delta(self, delta: float) -> Self:
        """Return the same game with another delta, in the same coordinates."""
        return replace(self, delta=delta)

    def game(self) -> Game:
        """Return the game in the coordinates y, with the R, N and delta of the user."""
        Q = self.Q
        if not is_semidefinite(Q):  # rounding of the change of coordinates
            half = scaled_root(Q)
            Q = half @ half.T
        game = Game(self.A, self.inputs, self.disturbance, Q, self.R, self.delta)
        if self.F is None:
            return game
        F = np.linalg.solve(self.T.T, self.F.T).T
        RF = self.R @ F
        return replace(game, A=self.A + self.inputs @ F, Q=Q + F.T @ RF, N=RF.T)

    @cached_property
    def B(self) -> np.ndarray:
        """B scaled to R = I, (..., n, m)."""
        return np.linalg.solve(self.root, self.inputs.mT).mT

    @cached_property
    def B_over_R(self) -> np.ndarray:
        """B R⁻¹ in the coordinates y, with R of the user, (..., n, m)."""
        return np.linalg.solve(self.root.T, self.B.mT).mT

    @cached_property
    def E(self) -> np.ndarray:
        """E scaled to δ = 1, (..., n, k)."""
        return self.disturbance / self.delta

    @cached_property
    def S(self) -> np.ndarray:
        """S = B B' - E E', (..., n, n)."""
        return self.B @ self.B.mT - self.E @ self.E.mT

    @cached_property
    def rounded(self) -> np.ndarray:
        """Error of B B' - E E' due to the rounding of `root`, B and E, (..., n, n), to first order.

        Near the smallest delta the two terms nearly cancel, and this error matters.
        """
        root = self.root
        half = np.zeros_like(self.A)
        if not np.array_equal(root, self.R):  # with R = I, B is unchanged
            of_B = remainder(self.inputs, self.B, root)
            of_root = 0.5 * self.B_over_R @ remainder(self.R, root, root)
            half = self.B_over_R @ (of_root - of_B).mT
        if math.isfinite(self.delta):
            deltas = np.eye(self.E.shape[-1]) * self.delta
            half = half + remainder(self.disturbance, self.E, deltas) / self.delta @ self.E.mT
        return half + half.mT

    @property
    def units(self) -> np.ndarray:
        """Units u with z_i = u_i y_i, (n,), powers of two. The form must not be `turned`."""
        return 1.0 / np.diag(self.T)

    def of_value(self, P: np.ndarray) -> np.ndarray:
        """Return the solution X in the coordinates y that belongs to P in the user's coordinates.

        The form must not be `turned`.

        P: (..., n, n)
        """
        return P * np.outer(self.units, self.units)

    @property
    def is_finite(self) -> np.ndarray:
        """Mask (...) of the games whose Hamiltonian does not overflow in these coordinates."""
        with np.errstate(all="ignore"):
            return np.isfinite(self.hamiltonian).all(axis=(-2, -1))

    @cached_property
    def hamiltonian(self) -> np.ndarray:
        """Hamiltonian [[A, -S], [-Q, -A']], (..., 2n, 2n)."""
        return hamiltonian(self.A, self.S, self.Q)

    @property
    def sizes(self) -> Sizes:
        """Magnitudes of the terms of A, B, E and Q.

        The result is `made_of`. If `made_of` is None, the result contains the magnitudes of the
        entries.
        """
        if self.made_of is not None:
            return self.made_of
        return Sizes(*(np.abs(each) for each in (self.A, self.B, self.disturbance, self.Q)))

    @property
    def hamiltonian_sizes(self) -> np.ndarray:
        """Magnitudes of the terms of the Hamiltonian of one game, (2n, 2n)."""
        A, B, E, Q = self.sizes
        E = E / self.delta
        return np.block([[A, B @ B.T + E @ E.T], [Q, A.T]])

    def residual(self, X: np.ndarray) -> np.ndarray:
        """Return A'X + X A + Q - X S X, (..., n, n), computed in twice the precision.

        Cancellation therefore causes no rounding error. Corrections of X by such residuals converge
        to the rounding of X, however badly conditioned the equation is (Wilkinson's iterative
        refinement).

        X: (..., n, n), symmetric
        """
        n = X.shape[-1]
        high, low = product_of_doubles(X, np.concatenate([self.A, self.B, self.E], axis=-1))
        linear = high[..., :n], low[..., :n]
        inputs = high[..., n:]
        signed = inputs.copy()
        signed[..., : self.B.shape[-1]] *= -1.0
        square = product_of_doubles(signed, inputs.mT)
        total = add(add(linear, transposed(linear)), add(exact(self.Q), square))
        mixed = signed @ low[..., n:].mT
        return total[0] + (mixed + mixed.mT + X @ self.rounded @ X)

    def relative_residual(self, X: np.ndarray) -> np.ndarray:
        """Return the largest residual of each game relative to the magnitude of its terms, (...).

        max |A'X + X A + Q - X S X| / max (|A|'|X| + |X||A| + |Q| + |X||S||X|), with |·| entry by
        entry and |S| = |B B'| + |E E'|.

        X: (..., n, n), symmetric
        """
        S_size = np.abs(self.B @ self.B.mT) + np.abs(self.E @ self.E.mT)
        size = np.abs(X)
        linear = X @ self.A
        residual = linear + linear.mT + self.Q - X @ self.S @ X
        linear = size @ np.abs(self.A)
        terms = linear + linear.mT + np.abs(self.Q) + size @ S_size @ size
        return largest(residual) / largest_or_1(terms)

    def value(self, X: np.ndarray) -> np.ndarray:
        """Return P = T'X T in the user's coordinates, (..., n, n), symmetric."""
        P = self.T.mT @ X @ self.T
        return (P + P.mT) / 2.0

    def gain(self, X: np.ndarray) -> np.ndarray:
        """Return K of the policy u = -K z in the user's coordinates, (..., m, n)."""
        K = self.B_over_R.mT @ X @ self.T
        return K if self.F is None else K + self.F

    def disturbance_gain(self, X: np.ndarray) -> np.ndarray:
        """Return L of the worst disturbance d = L z in the user's coordinates, (..., k, n)."""
        return (self.E.mT @ X @ self.T) / self.delta

    def turned(self) -> Self:
        """Return one game in coordinates in which P of its LQ problem is moderate.

        The form is unchanged if P is moderate, or if no such coordinates are found. Without the
        change, a mode that the inputs reach only by a small fraction r costs 1/r², and rounding of
        this cost hides all other modes.

        The change of coordinates is T <- D W'T. [X1; X2] is an orthonormal basis of the stable
        subspace, X1 = W cos(θ) Z', and tan(θ) are the singular values of P. The diagonal matrix D
        contains the units of the columns of W.

        Source: Golub and Van Loan, Matrix Computations, Section 6.4.3 (angles between subspaces).
        """

        form = self
        dearest = 1.0
        while dearest < 1.0 / RANK:
            basis = stable_basis(form.with_delta(np.inf).hamiltonian)
            if basis is None:
                break
            W, cosines, _ = np.linalg.svd(basis[: len(self.A)])
            if cosines[-1] > MODERATE:
                return form
            D = np.exp2(np.round(-0.5 * np.log2(cosines.clip(np.finfo(float).eps))))
            form = form._turned_by(W, D)
            dearest *= float(D[-1])
        return self

    def levelled(self) -> Self:
        """Return one game in coordinates in which P of its LQ problem is near I.

        If P cannot be computed, the result of `turned` is returned. Without the change, P of a
        plant with fast and slow states can have entries from 1e-11 to 1, and rounding of the fast
        states hides the slow states. If P has only rounding errors in a direction of the state
        space, the unit of this direction is not changed. At the end, the units are balanced
        (`units_of`).
        """

        form = self.turned()
        n = len(form.A)
        basis = stable_basis(form.with_delta(np.inf).hamiltonian)
        if basis is None or np.linalg.cond(basis[:n]) > 1.0 / RANK:
            return form
        X = np.linalg.solve(basis[:n].T, basis[n:].T)
        sizes, W = np.linalg.eigh((X + X.T) / 2.0)
        known = sizes > RANK * sizes[-1]
        units = np.exp2(np.round(0.5 * np.log2(np.where(known, sizes, 1.0))))
        form = form._turned_by(W, units)
        balance = units_of(form.A, form.B @ form.B.T, form.Q)
        return form._turned_by(np.eye(n), 1.0 / balance)

    def _turned_by(self, W: np.ndarray, D: np.ndarray) -> Self:
        """Return the game in the coordinates D W'y, rounded once at the end."""
        inverse = precise_inverse(W)
        Q = product(product(transposed(inverse), exact(self.Q)), inverse)[0]
        return replace(
            self,
            A=similar(exact(self.A), W, D)[0],
            inputs=product_of_doubles(W.T, self.inputs)[0] * D[:, None],
            disturbance=product_of_doubles(W.T, self.disturbance)[0] * D[:, None],
            Q=(Q + Q.T) / 2.0 / np.outer(D, D),
            T=D[:, None] * (W.T @ self.T),
            made_of=self.made_of and self.made_of.in_coordinates(D[:, None] * W.T, W / D),
        )


def similar(matrix: Pair, W: np.ndarray, D: np.ndarray) -> Pair:
    """Return (D W') M (D W')⁻¹ as a pair (high, low) of twice the precision.

    matrix: M, (n, n), as a pair
    W: (n, n), orthogonal up to rounding
    D: (n,), powers of two
    """
    high, low = product(product(exact(W.T), matrix), precise_inverse(W))
    scale = D[:, None] / D
    return high * scale, low * scale


def precise_inverse(W: np.ndarray) -> Pair:
    """Return (W')⁻¹ as a pair (high, low) of twice the precision.

    W: (n, n), orthogonal up to rounding
    """
    high, low = product_of_doubles(W.T, W)
    defect = np.eye(len(W)) - high, -low
    return add(exact(W), product(exact(W), defect))  # a step of Newton's method


def without_faint(matrix: np.ndarray, least: float) -> np.ndarray:
    """Return the matrix with 0 in place of entries below `least` in magnitude.

    Products of such small numbers would have no correct digits.
    """
    return np.where(np.abs(matrix) < least, 0.0, matrix)
