"""A game in continuous time, in the coordinates in which it is solved: R = I and δ = 1."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from controller.riccati.axis_distance import hamiltonian_axis_distance
from controller.riccati.balancing import (
    abscissa_of,
    hamiltonian,
    largest,
    largest_or_1,
)
from controller.riccati.double_double import Pair, exact, product_of_doubles
from controller.riccati.form import (
    LAST,
    Answer,
    Form,
    doubled,
)
from controller.riccati.lyapunov import Lyapunov
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import LARGEST
from hfa_support.reporting.checks import Check, at_least, checked

#: Smallest relative distance to the imaginary axis, above the rounding of this distance. Nearer to
#: the axis, rounding hides whether the Hamiltonian has n stable eigenvalues.
AXIS_DISTANCE = 2e-14
#: An entry of Q - N R⁻¹ N' below this fraction of that of Q is the rounding of twice the digits.
CANCELLED = 1e-26
#: Relative change of A below which a matrix counts as rank-deficient.
RANK = 1e-13
#: Magnitude of a negative eigenvalue of X1'X2 that counts as rounding.
SIGN_ROUNDING = 1e-12
_NO_GRAPH = "the Hamiltonian has no stable subspace that is the graph of a P"
_SINGULAR = "the equation of Newton's step for P is singular within rounding"


class HamiltonianSpectrum(NamedTuple):
    """Eigenvalues of a Hamiltonian, and its stable subspace.

    eigenvalues: (2n,)
    stable_basis: orthonormal basis (2n, n) of the subspace, or None if its dimension is not n
    """

    eigenvalues: np.ndarray
    stable_basis: np.ndarray | None


@dataclass(frozen=True, eq=False)
class NormalForm(Form):
    """Game in continuous time with R = I and δ = 1: A'X + X A + Q - X S X = 0, S = B B' - E E'.

    Source of the scaling by R^-½: Zhou, Doyle and Glover, Section 14.1.
    """

    is_discrete = False
    equation = "the Riccati equation"
    of_matrix = ""
    loop_words = ("A - S P", "A - B K")

    def without_cross_weights(self) -> Self:
        """Return the game with the input v + R⁻¹ N'y, from twice the digits."""
        if not self.N.any():
            return self
        F = np.linalg.solve(self.R, self.N.T)
        error = (exact(self.N.T) + -product_of_doubles(self.R, F)).high
        precise = exact(F) + exact(np.linalg.solve(self.R, error))
        A = (exact(self.A) + -(exact(self.inputs) @ precise)).high
        Q = (exact(self.Q) + -(exact(self.N) @ precise)).high
        sizes = np.sqrt(np.diag(self.Q))
        Q = np.where(np.abs(Q) > CANCELLED * np.outer(sizes, sizes), Q, 0.0)
        return replace(self, A=A, Q=(Q + Q.T) / 2.0, N=0.0 * self.N, F=self.V @ F)

    def effect(self) -> np.ndarray:
        """Return B R⁻¹ B', (n, n)."""
        return self.B @ self.B.T

    @property
    def price(self) -> np.ndarray:
        """R, (m, m)."""
        return self.R

    @cached_property
    def root(self) -> np.ndarray:
        """Cholesky factor of R = root root', (m, m)."""
        return np.linalg.cholesky(self.R)

    @cached_property
    def B(self) -> np.ndarray:
        """B scaled to R = I, (n, m)."""
        return np.linalg.solve(self.root, self.inputs.T).T

    @cached_property
    def S(self) -> np.ndarray:
        """S = B B' - E E', (n, n)."""
        return self.B @ self.B.T - self.E @ self.E.T

    @cached_property
    def hamiltonian(self) -> np.ndarray:
        """Hamiltonian [[A, -S], [-Q, -A']], (2n, 2n)."""
        return hamiltonian(self.A, self.S, self.Q)

    @cached_property
    def hamiltonian_spectrum(self) -> HamiltonianSpectrum:
        """Eigenvalues and stable subspace of the Hamiltonian, by its ordered Schur form.

        Raises NoSolutionError if the Schur form does not converge.
        """
        from scipy.linalg.lapack import dgees

        n = len(self.A)
        _, stable, real, imaginary, basis, _, failed = dgees(_is_stable, self.hamiltonian, sort_t=1)
        if 0 < failed <= 2 * n:
            raise NoSolutionError("the Schur form of the Hamiltonian does not converge")
        is_ordered = stable == n and not failed
        return HamiltonianSpectrum(real + 1j * imaginary, basis[:, :n] if is_ordered else None)

    def gains(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return K (m, n) and L (k, n) of v = -K y and d = L y, the policies of the value y'X y."""
        return np.linalg.solve(self.root.T, self.B.T @ X), self.E.T @ X / self.delta

    def residual(self, X: np.ndarray) -> np.ndarray:
        """Return A'X + X A + Q - X S X, (n, n), in twice the precision."""
        n, m = self.B.shape
        products = product_of_doubles(X, np.hstack([self.A, self.B, self.E]))
        XA = Pair(products.high[:, :n], products.low[:, :n])
        XG, XG_low = products.high[:, n:], products.low[:, n:]  # of G = [B E], X S X = X G W G'X
        negative = XG * np.repeat([-1.0, 1.0], [m, self.E.shape[1]])
        total = XA + XA.mT + (exact(self.Q) + product_of_doubles(negative, XG.T))
        mixed = negative @ XG_low.T
        return total.high + mixed + mixed.T

    def relative_residual(self, X: np.ndarray) -> float:
        """Return the largest residual for X relative to its terms.

        max |A'X + X A + Q - X S X| / max (|A|'|X| + |X||A| + |Q| + |X||S||X|), with |·| entry by
        entry and |S| = |B B'| + |E E'|.
        """
        S_size = np.abs(self.B @ self.B.T) + np.abs(self.E @ self.E.T)
        size = np.abs(X)
        linear = X @ self.A
        residual = linear + linear.T + self.Q - X @ self.S @ X
        terms = size @ np.abs(self.A)
        terms = terms + terms.T + np.abs(self.Q) + size @ S_size @ size
        return largest(residual) / largest_or_1(terms)

    def newton_step(self, X: np.ndarray) -> np.ndarray:
        """Return the Newton correction Z, (n, n): (A - S X)'Z + Z (A - S X) + residual(X) = 0.

        Raises NoSolutionError if this equation is singular within rounding.
        """
        try:
            Z, is_singular = Lyapunov(self.A - self.S @ X).solve(-self.residual(X))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise NoSolutionError(_SINGULAR) from error
        if is_singular:
            raise NoSolutionError(_SINGULAR)
        return Z

    def unrefined(self) -> np.ndarray:
        """Return X, (n, n), from the stable subspace of the Hamiltonian; exactly 0 for Q = 0 and a
        stable A.

        Source: Laub, IEEE Trans. Automatic Control 24 (1979), 913-921.

        Raises NoSolutionError if the stable subspace [V1; V2] does not have dimension n, or V1 is
        singular.
        """
        if self._costs_nothing:
            return np.zeros_like(self.A)
        basis = self.hamiltonian_spectrum.stable_basis
        if basis is None:
            raise NoSolutionError(_NO_GRAPH)
        V1, V2 = np.split(basis, 2)
        try:
            X = np.linalg.solve(V1.T, V2.T)
        except np.linalg.LinAlgError as error:
            raise NoSolutionError(_NO_GRAPH) from error
        return X

    @property
    def _costs_nothing(self) -> bool:
        return not self.Q.any() and abscissa_of(self.A) < 0.0

    def by_doubling(self) -> np.ndarray:
        """Return X, (n, n), by the structure-preserving doubling algorithm.

        X is the limit of the optimal costs over 2^k steps with the final cost p I, p = `LAST`.

        T = -2c [[A - S p - c I, -S], [-Q - p (A + A' - S p), -(A - S p - c I)']]^-1

        T defines a game in steps with the loop I - T11, S = T12 and the cost Y = T21 of one step
        (`doubled`). The solution of the given game is p I + Y. c is slightly below the geometric
        mean of the largest and the smallest |λ|, because an eigenvalue may be at the mean itself.
        Source: Chu, Fan and Lin, Linear Algebra Appl. 396 (2005), 55-80.

        Raises NoSolutionError if a matrix is singular.
        """
        n = len(self.A)
        one = np.eye(n)
        sizes = np.abs(self.hamiltonian_spectrum.eigenvalues)
        c = 0.9 * math.sqrt(sizes.max() * sizes.min())
        A = self.A - LAST * self.S
        Q = self.Q + LAST * (A + self.A.T)
        try:
            with np.errstate(all="ignore"):
                T = -2.0 * c * np.linalg.inv(hamiltonian(A - c * one, self.S, Q))
                Y = doubled(one - T[:n, :n], T[:n, n:], T[n:, :n])
        except np.linalg.LinAlgError as error:
            raise NoSolutionError("doubling meets a singular matrix") from error
        return Y + LAST * one

    @property
    def _is_finite(self) -> bool:
        with np.errstate(all="ignore"):
            sizes = largest(self.hamiltonian), largest(self.disturbance)
        return max(sizes) <= LARGEST  # of nan, this is false

    def axis_checks(self) -> tuple[Check, ...]:
        """Return the checks that the Hamiltonian has n eigenvalues on each side of the imaginary
        axis, and none near it.

        Raises NoSolutionError if entries of H overflow.
        """
        if not self._is_finite:
            raise NoSolutionError(
                "the computation overflows, because the entries of the game differ too much in"
                " size; check the scaling of A, B, E, Q and R"
            )
        eigenvalues = self.hamiltonian_spectrum.eigenvalues
        stable = int(np.sum(eigenvalues.real < 0.0))
        distance, frequency = hamiltonian_axis_distance(self.hamiltonian, eigenvalues)
        n = len(self.A)
        near = (
            f"a change of {distance:.2g} of the Hamiltonian, relative, puts an eigenvalue on the"
            f" imaginary axis at {frequency:.4g} rad/s"
        )
        split = f"the Hamiltonian has {stable} stable eigenvalues instead of {n}"
        return (
            at_least("hamiltonian_axis_distance", distance, AXIS_DISTANCE, near),
            checked("hamiltonian_split", stable, n, split, relation="=="),
        )

    def loops(self, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return A - S X and A - B B'X, (n, n)."""
        return self.A - self.S @ X, self.A - self.B @ (self.B.T @ X)

    def existence(self) -> Answer:
        """Return whether the game has a value.

        Let [X1; X2] be an orthonormal basis of the stable subspace of the Hamiltonian. The value
        exists if the subspace has dimension n, no eigenvalue is on the imaginary axis, and X1'X2 =
        X1'P X1 is positive semidefinite. As delta falls to its minimum, P grows without bound, but
        X1 and X2 remain bounded, and an eigenvalue of X1'X2 passes through zero.

        Source: Basar and Bernhard, H-infinity Optimal Control, Section 4.5 (conjugate points).
        """
        if self._costs_nothing:
            return Answer(True)
        if not self._is_finite:
            return Answer(False, "the entries of the game overflow")
        eigenvalues = self.hamiltonian_spectrum.eigenvalues
        distance, frequency = hamiltonian_axis_distance(self.hamiltonian, eigenvalues)
        basis = self.hamiltonian_spectrum.stable_basis
        if basis is None or distance < AXIS_DISTANCE:
            reason = (
                f"for every input, the gain from the disturbance is at least {self.delta:.6g}"
                f" (at {frequency:.4g} rad/s)"
            )
            return Answer(False, reason)
        X1, X2 = np.split(basis, 2)
        smallest = float(np.linalg.eigvalsh(X1.T @ X2 + X2.T @ X1)[0])
        return Answer(smallest > -SIGN_ROUNDING, "P is indefinite", excess=smallest)

    @property
    def without_input(self) -> tuple[np.ndarray, np.ndarray]:
        """A and Q."""
        return self.A, self.Q

    @property
    def reach(self) -> np.ndarray:
        """B for R = I, (n, m)."""
        return self.B

    def beyond(self, value: complex) -> tuple[float, complex]:
        """Return Re λ, and j Im λ."""
        return value.real, 1j * value.imag


def _is_stable(real: float, imaginary: float) -> bool:
    """Return whether an eigenvalue belongs to the stable subspace."""
    return real < 0.0
