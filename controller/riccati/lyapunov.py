"""Lyapunov equations F'Z + Z F = C, in discrete time F'Z F - Z = C, and what they prove of loops.

Candidate solutions are computed in doubles or in many bits; balls prove what follows from them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    Balls,
    DoubleBalls,
    Matrix,
    ball_matrix,
    bits,
    identity,
    is_positive_definite,
    midpoints,
    norm,
    precision,
    scaled_balls,
    symmetric,
)
from hfa_support.matrices import balanced

if TYPE_CHECKING:
    from flint import arb, arb_mat


#: Largest number of steps of Newton's method.
NEWTON_STEPS = 150
#: Relative shift of a loop that is sought to be unstable with poles s and -s.
SLOWER = 2.0**-10


class FailedError(Exception):
    """Raised if no candidate solution is found, with the step that fails."""


class NotProvedError(Exception):
    """Raised if a candidate does not prove what is asked, with the step that fails."""


class Lyapunov:
    """Solver of F'Z + Z F = C for one F (n, n) and symmetric C (n, n), by the Schur form of F.

    Raises LinAlgError if the Schur form does not converge, and ValueError for infinite entries.
    Source: Bartels and Stewart, Communications of the ACM 15 (1972), 820-826.
    """

    def __init__(self, F: np.ndarray) -> None:
        from scipy.linalg.lapack import dgees

        self._T, _, _, _, self._U, _, failed = dgees(_unsorted, np.asarray_chkfinite(F))
        if failed:
            raise np.linalg.LinAlgError("the Schur form does not converge")
        self._into = np.eye(len(F))  # the right side is into'C into, see `of_steps`

    @classmethod
    def of_steps(cls, F: np.ndarray) -> Self:
        """Return the solver of F'Z F - Z = C, whose F must not have the eigenvalue -1.

        With W = (F + 1)⁻¹, it has the solution of F₁'Z + Z F₁ = 2 W'C W with F₁ = (F - 1) W.
        """
        one = np.eye(len(F))
        W = np.linalg.inv(F + one)
        solver = cls((F - one) @ W)
        solver._into = np.sqrt(2.0) * W
        return solver

    def solve(self, C: np.ndarray) -> np.ndarray:
        """Return Z, (n, n), symmetric."""
        from scipy.linalg.lapack import dtrsyl

        into = self._into @ self._U
        Z, scale, _ = dtrsyl(self._T, self._T, into.T @ C @ into, trana="T")
        Z = self._U @ (Z / scale) @ self._U.T
        return (Z + Z.T) / 2.0


def _unsorted(real: float, imaginary: float) -> None:
    """Leave the eigenvalues of a Schur form in any order."""


def change_along(loop: Matrix, Y: Matrix, *, is_discrete: bool) -> Matrix:
    """Return the change of z'Y z along z' = F z, F'Y + Y F, in discrete time F'Y F - Y."""
    if is_discrete:
        return loop.T @ (Y @ loop) - Y
    product = Y @ loop
    return product + product.T


def lyapunov_of(F: np.ndarray, *, is_discrete: bool) -> Lyapunov:
    """Return the solver of F'Z + Z F = C, in discrete time of F'Z F - Z = C."""
    return Lyapunov.of_steps(F) if is_discrete else Lyapunov(F)


def discounted(loop: arb_mat, game: Game) -> arb_mat:
    """Return √α times a loop, (n, n), on which the cost depends."""
    from flint import arb

    return loop if game.discount == 1.0 else loop * arb(game.discount).sqrt()


def shape_in_doubles(
    F: np.ndarray, solver: Lyapunov | None = None, *, is_discrete: bool
) -> np.ndarray:
    """Return Y of F'Y + Y F = -1, in discrete time of F'Y F - Y = -1, (n, n), corrected once.

    solver: of nearly the same loop

    Raises LinAlgError or ValueError where LAPACK fails.
    """
    solver = solver or lyapunov_of(F, is_discrete=is_discrete)
    one = np.eye(len(F))
    Y = solver.solve(-one)
    change = F.T @ Y @ F - Y if is_discrete else F.T @ Y + Y @ F
    return np.asarray(Y - solver.solve(change + one))


def loop_units(F: np.ndarray) -> np.ndarray:
    """Return units of the states, exponents of two, in which a loop is balanced, (n,) integers."""
    return np.round(np.log2(balanced(F)[1])).astype(int)


def lyapunov_in_bits(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat:
    """Return a candidate for the solution of F'D + D F + C = 0, (n, n), in as many bits.

    By LAPACK, corrected by residuals in balls; by the matrix sign function if they do not shrink.
    In discrete time, the equation is F'D F - D + C = 0.

    Raises FailedError.
    """
    try:
        D = _refined_lyapunov(loop, C, is_discrete=is_discrete)
    except (np.linalg.LinAlgError, ValueError):
        D = None
    if D is not None:
        return D
    return lyapunov_by_sign_function(loop.mid(), C.mid(), is_discrete=is_discrete)


def _refined_lyapunov(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat | None:
    """Return D by LAPACK, corrected by residuals in balls as long as each is a tenth of the last,
    or None if the last one is not small.

    Raises LinAlgError or ValueError where LAPACK fails.
    """
    from flint import arb

    solver = lyapunov_of(midpoints(loop), is_discrete=is_discrete)
    F, D, size_before = Balls(loop.mid()), Balls.of(solver.solve(-midpoints(C))), arb("inf")
    while True:
        residual = change_along(F, D, is_discrete=is_discrete) + Balls(C.mid())
        size = residual.mid().norm()
        if not size < size_before * 0.1:
            is_small = size <= norm(C) * half_the_bits() or size == 0
            return D.matrix if is_small else None
        size_before = size
        D = (D + Balls.of(solver.solve(-residual.midpoint))).mid()


def lyapunov_by_sign_function(F: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat:
    """Return D of F'D + D F + C = 0, (n, n), in discrete time of F'D F - D + C = 0.

    By Newton's method for the sign of [[F, 0], [C, -F']], which is [[-1, 0], [2 D, 1]]. In discrete
    time, D is the solution for (F - 1) W and 2 W'C W with W = (F + 1)⁻¹.

    Source: Roberts, International Journal of Control 32 (1980), 677-687.
    Raises FailedError if it does not converge.
    """
    D = C
    if is_discrete:
        one = identity(F.nrows())
        W = _inverse(F + one)
        F, D = ((F - one) * W).mid(), (W.transpose() * C * W * 2).mid()
    for step in range(NEWTON_STEPS):
        inverse = _inverse(F)
        scale = _newton_scale(F, inverse, step)
        D = ((D * scale + inverse.transpose() * D * inverse * (1 / scale)) * 0.5).mid()
        next_F = ((F * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(next_F - F) <= norm(next_F) * half_the_bits():
            return (D * 0.5).mid()
        F = next_F
    raise FailedError("the loop may be on the axis")


def sign_function(matrix: arb_mat) -> arb_mat:
    """Return the matrix sign function, the limit of (M + M⁻¹)/2 in each step (Newton).

    Raises FailedError if it does not converge.
    """
    for step in range(NEWTON_STEPS):
        inverse = _inverse(matrix)
        scale = _newton_scale(matrix, inverse, step)
        next_matrix = ((matrix * scale + inverse * (1 / scale)) * 0.5).mid()
        if scale == 1 and norm(next_matrix - matrix) <= norm(next_matrix) * half_the_bits():
            return ((next_matrix + _inverse(next_matrix)) * 0.5).mid()
        matrix = next_matrix
    raise FailedError("an eigenvalue may be on the axis")


def _inverse(matrix: arb_mat) -> arb_mat:
    """Return the inverse without radii.

    Raises FailedError if the matrix may be singular.
    """
    try:
        return matrix.inv().mid()
    except ZeroDivisionError:
        raise FailedError("a matrix is singular with these bits") from None


def _newton_scale(matrix: arb_mat, inverse: arb_mat, step: int) -> arb:
    """Return the factor c of a Newton step (c M + (c M)⁻¹)/2 that brings the eigenvalues near ±1
    soon; 1 where they are near, and in late steps.
    """
    from flint import arb

    factor = (norm(inverse) / norm(matrix)).sqrt().mid()
    is_near = bool(factor > 0.9) and bool(factor < 1.1)
    return arb(1) if is_near or step > NEWTON_STEPS // 2 else factor


def half_the_bits() -> arb:
    """Return 2^(-bits/2): after a Newton step as small, the next is exact up to the last bits."""
    from flint import arb

    return arb(2) ** (-bits() // 2)


def proves_stable(loop: Matrix, Y: Matrix, most: float = 1.0, *, is_discrete: bool) -> bool:
    """Return whether Y proves a loop F stable: Y > 0 and |F'Y + Y F + 1| < most <= 1.

    In discrete time, |F'Y F - Y + 1| < most.
    """
    one = type(Y).of(np.eye(Y.rows))
    defect = (change_along(loop, Y, is_discrete=is_discrete) + one).norm()
    return bool(defect < most) and Y.is_positive_definite()


def symmetric_in(arithmetic: type[Matrix], Y: Balls | np.ndarray) -> Matrix:
    """Return the exact midpoints of the symmetric part of Y, in an arithmetic."""
    return arithmetic.of((Y + Y.T) / 2.0 if isinstance(Y, np.ndarray) else Y.symmetric())


def stability_of(loop: arb_mat, *, is_discrete: bool) -> bool | None:
    """Return whether a loop F is stable, or None if the bits of `precision` do not prove it.

    Let |F'Y + Y F + 1| < 1, in discrete time |F'Y F - Y + 1| < 1. F is stable if Y > 0, and not if
    Y is not, because Y would be positive definite if F were stable. The equation of Y is singular
    for poles s and -s: F is not stable, too, if F - c, in discrete time F (1 - c), is not for a
    small c > 0.

    loop: F, (n, n), balls
    """
    from flint import arb

    units = loop_units(midpoints(loop))
    F, one = scaled_balls(loop, -units, units), identity(loop.nrows())
    in_doubles = DoubleBalls.of(F)
    try:
        Y = shape_in_doubles(in_doubles.midpoint, is_discrete=is_discrete)
    except (np.linalg.LinAlgError, ValueError):
        Y = np.zeros(in_doubles.midpoint.shape)
    if proves_stable(in_doubles, symmetric_in(DoubleBalls, Y), is_discrete=is_discrete):
        return True
    is_stable = _by_shape(F, is_discrete=is_discrete)
    if is_stable is not None:
        return is_stable
    slower = F * (1 - arb(SLOWER)) if is_discrete else F - one * norm(F).mid() * SLOWER
    return False if _by_shape(slower, is_discrete=is_discrete) is False else None


def _by_shape(F: arb_mat, *, is_discrete: bool) -> bool | None:
    """Return whether a loop is stable by its own Y, or None."""
    one = identity(F.nrows())
    try:
        Y = symmetric(lyapunov_in_bits(F, one, is_discrete=is_discrete))
    except FailedError:
        return None
    defect = change_along(Balls(F), Balls(Y), is_discrete=is_discrete).matrix + one
    return is_positive_definite(Y) if norm(defect) < 1 else None


def loop_with(game: Game, K: arb_mat) -> arb_mat:
    """Return A - B K in balls, (n, n)."""
    return ball_matrix(game.A) - ball_matrix(game.B) * K


def discounted_loop(game: Game, K: arb_mat) -> arb_mat:
    """Return √α (A - B K) in balls, (n, n), on which the cost depends."""
    return discounted(loop_with(game, K), game)


def stabilizes(game: Game, K: np.ndarray, *, is_discounted: bool = False) -> bool:
    """Return whether A - B K is proved stable, or √α (A - B K); False without a proof.

    K: (m, n)
    is_discounted: whether √α (A - B K) is asked about
    """
    loop_of = discounted_loop if is_discounted else loop_with
    for attempt in ATTEMPTS:
        with precision(attempt):
            is_stable = stability_of(loop_of(game, ball_matrix(K)), is_discrete=game.is_discrete)
        if is_stable is not None:
            return is_stable
    return False
