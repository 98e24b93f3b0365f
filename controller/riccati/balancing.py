"""Matrices and games in units in which their numbers are of similar size: eigenvalues seen there,
the normal form.

Where digits would be lost, products of matrices have twice the digits of double precision, by
products of doubles alone. Such a number is a pair (high, low) whose sum it is, |low| <= 2^-53
|high|. Each matrix is cut into slices so short that products of slices are free of rounding,
whatever the order of summation. Source: Ozaki, Ogita, Oishi and Rump, Numerical Algorithms 59
(2012), 95-118."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game

#: Smaller cosines belong to a P of more than the inverse of this, in balanced units.
MODERATE = 1e-4
#: What a rank test may leave of a matrix without full rank, relative to A. A mode reached by less
#: is not reached.
RANK = 1e-13
#: Of more frequencies than this, a singular value is computed at so many that seem nearest.
FEW = 8
#: Of 22 to 25 bits each up to 100 columns: together more than twice the digits of a double.
SLICES = 5

Pair = tuple[Any, Any]


class Spectrum(NamedTuple):
    """Eigenvalues of M, sorted by real part, then imaginary part, and M balanced by a diagonal
    similarity."""

    eigenvalues: np.ndarray
    balanced: np.ndarray

    @property
    def abscissa(self) -> float:
        """Largest real part, rad/s."""
        return float(self.eigenvalues.real.max())

    def axis_distance(self) -> float:
        """min_ω σ_min(M - jω I) / ‖M‖₂ of the balanced M, over the imaginary parts ω of the
        eigenvalues.

        How far M is, relative, from a matrix with an eigenvalue on the imaginary axis. Unlike |Re
        λ| it does not mislead when an eigenvalue is badly conditioned: a double eigenvalue on the
        axis is computed with |Re λ| of about 1e-8 ‖M‖, but its axis_distance is of the order of
        rounding, 1e-16. Source: Byers 1988."""
        return self.nearest_to_axis()[0]

    def nearest_to_axis(self) -> tuple[float, float]:
        """`axis_distance`, and the ω >= 0 where it is, rad/s."""
        frequencies = np.unique(np.abs(self.eigenvalues.imag))
        if len(frequencies) > FEW:  # to first order, of each eigenvalue: |Re λ| over its condition
            values, vectors = np.linalg.eig(self.balanced)
            near = np.abs(values.real) / np.linalg.norm(np.linalg.pinv(vectors), axis=1)
            frequencies = np.unique(np.abs(values.imag[np.argsort(near)[: 2 * FEW]]))
        shifted = self.balanced - 1j * frequencies[:, None, None] * np.eye(len(self.balanced))
        smallest = np.linalg.svd(shifted, compute_uv=False)[:, -1]
        place, norm = int(np.argmin(smallest)), float(np.linalg.norm(self.balanced, 2))
        return float(smallest[place]) / norm if norm > 0.0 else 0.0, float(frequencies[place])


def spectrum(matrix: np.ndarray) -> Spectrum:
    """The eigenvalues of a matrix, (n, n)."""
    scaled, _ = balanced(matrix)
    eigenvalues = np.linalg.eigvals(scaled)
    return Spectrum(eigenvalues[np.lexsort((eigenvalues.imag, eigenvalues.real))], scaled)


def is_hurwitz(matrix: np.ndarray) -> bool:
    """True when every eigenvalue has a negative real part."""
    return spectrum(matrix).abscissa < 0.0


def balanced(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """D⁻¹ M D, its rows and columns of similar size, and the diagonal of D, powers of two (LAPACK
    gebal)."""
    from scipy.linalg.lapack import (
        dgebal,
    )  # SciPy's matrix_balance takes ten times as long around it

    scaled, _, _, scaling, _ = dgebal(np.asarray_chkfinite(matrix), scale=1, permute=0)
    return scaled, scaling


class Turned(Game):
    """A game in the coordinates of `reached`, which `balanced_units` leaves alone."""


@lru_cache(maxsize=16)
def balanced_units(game: Game) -> np.ndarray:
    """Units u, (n,), powers of two: with z_i = u_i y_i the Hamiltonian of the game in y is
    balanced.

    P in the new units is P_ij u_i u_j. Powers of two make the change of units free of rounding. The
    units are taken from the game rather than from P, so that an entry of P that is zero up to
    rounding stays small. Source: Benner, Symplectic balancing of Hamiltonian matrices, SIAM J. Sci.
    Comput. 22 (2001)."""
    n = len(game.A)
    units = np.ones(n)
    if not isinstance(game, Turned):
        _, scaling = balanced(np.block([[game.A, -game.S], [-game.Q, -game.A.T]]))
        units = np.exp2(np.round(0.5 * (np.log2(scaling[:n]) - np.log2(scaling[n:]))))
    units.setflags(write=False)  # the same array for whoever asks about this game
    return units


def in_units(game: Game, units: np.ndarray) -> Game:
    """The same game in the state y, z_i = u_i y_i; units: (n,)."""
    return game.unchecked(
        A=game.A * units / units[:, None],
        B=game.B / units[:, None],
        E=game.E / units[:, None],
        Q=game.Q * np.outer(units, units),
    )


@dataclass(frozen=True, eq=False)
class NormalForm:
    """A'X + X A + Q - X S X = 0 with S = B B' - E E': the game in balanced units, its inputs scaled
    to R = I, δ = 1.

    units: (n,). The P of the game is X_ij / (u_i u_j).
    """

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    Q: np.ndarray
    units: np.ndarray

    @cached_property
    def hamiltonian(self) -> np.ndarray:
        """[[A, -S], [-Q, -A']], (2n, 2n)."""
        return np.block([[self.A, -self.S], [-self.Q, -self.A.T]])

    @cached_property
    def S(self) -> np.ndarray:
        """B B' - E E', (n, n)."""
        return self.B @ self.B.T - self.E @ self.E.T

    def residual(self, X: np.ndarray) -> np.ndarray:
        """A'X + X A + Q - X S X, (n, n), X symmetric, with twice the digits: what cancels in it
        leaves no rounding.

        Corrections of X by such residuals end at the rounding of X itself, however badly
        conditioned the equation (Wilkinson's iterative refinement). In double precision they end at
        a relative error of 1e-16 times the condition, which is 1e-6 a thousandth above the smallest
        δ of an ordinary game of ten states."""
        n, m = self.B.shape
        high, low = product(exact(X), exact(np.hstack([self.A, self.B, self.E])))
        total = add((high[:, :n], low[:, :n]), add((high[:, :n].T, low[:, :n].T), exact(self.Q)))
        signs = np.repeat([-1.0, 1.0], [m, self.E.shape[1]])
        right = high[:, n:].T, low[:, n:].T
        return np.asarray(add(total, product((high[:, n:] * signs, low[:, n:] * signs), right))[0])

    def value(self, X: np.ndarray) -> np.ndarray:
        """P of the game in the user's units, symmetric."""
        return (X + X.T) / 2.0 / np.outer(self.units, self.units)


def stable_basis(hamiltonian: np.ndarray) -> np.ndarray | None:
    """(2n, n), orthonormal, of the stable subspace; None where that has not half the dimension.

    Of LAPACK itself, because SciPy's ordered Schur form asks Python about each eigenvalue: a signal
    that comes there makes it print two lines of its own."""
    from scipy.linalg.lapack import dgees, dtrsen

    half = len(hamiltonian) // 2
    form, _, growth, _, basis, _, lost = dgees(lambda *_: 0, hamiltonian)  # not asked
    if lost:
        return None
    _, basis, growth, *_, lost = dtrsen(growth < 0.0, form, basis, job=b"N")
    return (
        None
        if lost or not np.array_equal(growth < 0.0, np.arange(2 * half) < half)
        else basis[:, :half]
    )


def stable_graph(hamiltonian: np.ndarray) -> np.ndarray:
    """P, (n, n), with [I; P] a basis of the stable subspace; np.linalg.LinAlgError where there is
    none."""
    basis, half = stable_basis(hamiltonian), len(hamiltonian) // 2
    if basis is None:
        raise np.linalg.LinAlgError
    return np.linalg.solve(basis[:half].T, basis[half:].T)


def normal_form(game: Game) -> NormalForm:
    """Source of the scaling by R^-½: Zhou, Doyle and Glover, Section 14.1."""
    units = balanced_units(game)
    alike = in_units(game, units)
    B = np.linalg.solve(np.linalg.cholesky(alike.R), alike.B.T).T
    return NormalForm(alike.A, B, alike.E / alike.delta, (alike.Q + alike.Q.T) / 2.0, units)


@lru_cache(maxsize=16)
def reached(game: Game) -> tuple[Game, np.ndarray]:
    """The same game in y = T z, where its P without disturbance is of size 1 at most, and T, (n,
    n).

    The game itself and the identity where P is of moderate size in balanced units. A mode that the
    input reaches by the part r alone costs 1/r², and the rounding of that hides all the rest: T = D
    W' turns the directions W of P into axes and takes other units D for the dear ones, with twice
    the digits on the way. P = T'P_y T, K = K_y T. With the basis [X1; X2] of the stable subspace X1
    = W cos(θ) Z', and tan(θ) are the eigenvalues of P. Source: Golub and Van Loan, Matrix
    Computations, Section 6.4.3 (angles between subspaces)."""
    turned, T, dearest = game, np.eye(len(game.A)), 1.0
    while dearest < 1.0 / RANK:
        form = normal_form(turned.with_delta(np.inf))
        basis = stable_basis(form.hamiltonian)
        if basis is None:
            break
        W, cosines, _ = np.linalg.svd(basis[: len(T)])
        if cosines[-1] > MODERATE:
            return turned, T
        D = np.exp2(np.round(-0.5 * np.log2(cosines.clip(np.finfo(float).eps))))
        turned = _turned(in_units(turned, form.units), W, D)
        T = D[:, None] * W.T @ (T / form.units[:, None])
        dearest *= D[-1]
    return game, np.eye(len(game.A))


def _turned(game: Game, W: np.ndarray, D: np.ndarray) -> Game:
    """The game in y = D W'z, W orthogonal but for rounding, D powers of two, with one rounding at
    the end."""
    rows, rough = exact(W.T), exact(W)
    high, low = product(rows, rough)
    inverse = add(rough, product(rough, (np.eye(len(W)) - high, -low)))  # a step of Newton's method
    columns = inverse[0].T, inverse[1].T
    A, Q = (
        product(product(left, exact(M)), inverse)[0]
        for left, M in ((rows, game.A), (columns, game.Q))
    )
    B, E = (product(rows, exact(M))[0] * D[:, None] for M in (game.B, game.E))
    return Turned(A * D[:, None] / D, B, E, (Q + Q.T) / 2.0 / np.outer(D, D), game.R, game.delta)


def product(left: Pair, right: Pair) -> Pair:
    """left right, (p, n) (n, q), to about 2^-105 of the largest entry of the row times that of the
    column."""
    bits = (53 - math.ceil(math.log2(SLICES * max(left[0].shape[1], 1)))) // 2
    rows, columns = _slices(left, bits, 1), _slices(right, bits, 0)
    total = np.zeros((len(left[0]), right[0].shape[1])), 0.0
    for order in range(
        SLICES, 0, -1
    ):  # all products of slices of one size at once, the smallest first
        part = np.concatenate(rows[:order], axis=1) @ np.concatenate(columns[order - 1 :: -1])
        total = add((part, 0.0), total)
    return total


def add(left: Pair, right: Pair) -> Pair:
    """left + right to about 2^-104 of the larger one (Knuth's sum without error, of the high
    parts)."""
    high = left[0] + right[0]
    back = high - left[0]
    low = (left[0] - (high - back)) + (right[0] - back) + (left[1] + right[1])
    both = high + low
    return both, low - (both - high)


def exact(matrix: np.ndarray) -> Pair:
    """The doubles themselves."""
    return matrix, 0.0


def _slices(pair: Pair, bits: int, axis: int) -> list[np.ndarray]:
    """Slices of so many bits, whose sum is the pair but for what lies below the last one; one scale
    a row or column."""
    rest, low = pair
    exponent = np.frexp(np.abs(rest).max(axis=axis, keepdims=True, initial=0.0))[1]
    slices = []
    for number in range(1, SLICES + 1):
        if number in (3, SLICES):  # the low part begins below two slices
            rest, low = add((rest, 0.0), (low, 0.0))
        # Beside this number a double has no bits below the slice.
        shift = np.ldexp(1.5, exponent + (52 - number * bits))
        slices.append((rest + shift) - shift)
        rest = rest - slices[-1]
    return slices
