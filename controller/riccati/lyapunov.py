"""Lyapunov equations F'Z + Z F = C, in discrete time F'Z F - Z = C, and what they prove of loops.

Candidate solutions are computed in doubles or in many bits; balls prove what follows from them.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    Balls,
    DoubleBalls,
    Matrix,
    ball_matrix,
    bits,
    is_positive_definite,
    midpoints,
    precision,
    scaled_balls,
)
from hfa_support.matrices import balanced

if TYPE_CHECKING:
    from flint import arb, arb_mat


#: Largest number of steps of Newton's method.
NEWTON_STEPS = 150
#: After such a relative change in doubles, the next step is exact up to the last digits.
HALF_THE_DIGITS = 2.0**-22


class FailedError(Exception):
    """Raised if no candidate solution is found, with the step that fails."""


class NotProvedError(Exception):
    """Raised if a candidate does not prove what is asked, with the step that fails."""


#: Matrix of which only midpoints are computed, in doubles or in the bits of `precision`.
Middle = TypeVar("Middle", Balls, np.ndarray)


class SignFunction(Generic[Middle]):
    """Sign of a matrix M, by Newton's method, (c M + (c M)⁻¹)/2 in each step, without radii.

    sign: -1 on the stable subspace of M, and 1 on the unstable one
    stable: number of eigenvalues with Re λ < 0

    Raises FailedError if it does not converge.
    Source: Roberts, International Journal of Control 32 (1980), 677-687.
    """

    sign: Middle
    stable: int

    def __init__(self, matrix: Middle) -> None:
        self._steps: list[tuple[float, Middle]] = []
        accuracy = float(half_the_bits()) if isinstance(matrix, Balls) else HALF_THE_DIGITS
        size = _size(matrix)
        for step in range(NEWTON_STEPS):
            inverse = _inverse(matrix)
            # This factor brings the eigenvalues near ±1 soon.
            c = math.sqrt(_size(inverse) / size)
            if not 0.0 < c < math.inf:
                raise FailedError("the sign is not finite")
            is_near = 0.9 < c < 1.1 or step > NEWTON_STEPS // 2
            c = 1.0 if is_near else c
            self._steps.append((c, inverse))
            before, matrix = matrix, _middle((matrix * c + inverse * (1.0 / c)) * 0.5)
            size = _size(matrix)
            if is_near and _size(matrix - before) <= accuracy * size:
                break
        else:
            raise FailedError("an eigenvalue may be on the axis")
        self.sign = matrix
        in_doubles = _in_doubles(matrix)
        self.stable = round((len(in_doubles) - float(np.trace(in_doubles))) / 2.0)

    def lyapunov(self, C: Middle) -> Middle:
        """Return D with M'D + D M = C sign + sign'C, (n, n), for a symmetric C.

        The sign of [[M, 0], [C, -M']] is [[sign, 0], [D, -sign']].
        """
        D = C
        for c, inverse in self._steps:
            D = _middle((D * c + inverse.T @ D @ inverse * (1.0 / c)) * 0.5)
        return _middle((D + D.T) * 0.5)


def _in_doubles(matrix: Any) -> np.ndarray:
    """Return a matrix in doubles."""
    return matrix if isinstance(matrix, np.ndarray) else matrix.midpoint


def _middle(matrix: Any) -> Any:
    """Return a matrix without radii."""
    return matrix if isinstance(matrix, np.ndarray) else matrix.mid()


def _size(matrix: Any) -> float:
    """Return a norm."""
    return float(np.linalg.norm(matrix) if isinstance(matrix, np.ndarray) else matrix.norm())


def _inverse(matrix: Any) -> Any:
    """Return the inverse without radii.

    Raises FailedError if the matrix may be singular.
    """
    try:
        if isinstance(matrix, np.ndarray):
            return np.linalg.inv(matrix)
        return Balls(matrix.matrix.inv().mid())
    except (ZeroDivisionError, np.linalg.LinAlgError):
        raise FailedError("a matrix is singular") from None


class Lyapunov(Generic[Middle]):
    """Solver of F'Z + Z F = C, in discrete time of F'Z F - Z = C, for one loop F, (n, n).

    In discrete time, with W = (F + 1)⁻¹, it is the equation of (F - 1) W and 2 W'C W.

    Raises FailedError if an eigenvalue of F may be on the boundary of stability.
    """

    def __init__(self, F: Middle, *, is_discrete: bool) -> None:
        one: Any = np.eye(len(_in_doubles(F)))
        self._one: Any = one if isinstance(F, np.ndarray) else Balls.of(one)
        self._W: Any = _inverse(F + self._one) if is_discrete else None
        of_rates = _middle((F - self._one) @ self._W) if is_discrete else F
        self.sign_function: SignFunction[Middle] = SignFunction(of_rates)

    @property
    def is_stable(self) -> bool:
        """Whether the eigenvalues of F are stable, up to rounding."""
        return self.sign_function.stable == len(_in_doubles(self._one))

    def _right(self, C: Middle) -> Middle:
        """Return C, in discrete time 2 W'C W."""
        return C if self._W is None else self._W.T @ C @ self._W * 2.0

    def solve(self, C: Middle) -> Middle:
        """Return Z, (n, n), symmetric.

        Raises FailedError if F is not stable.
        """
        if not self.is_stable:
            raise FailedError("the loop is not stable")
        return self.sign_function.lyapunov(self._right(C)) * -0.5

    def shape(self) -> Middle:
        """Return Y, (n, n), symmetric, of F'Y + Y F = -(1 + sign'sign)/2, in discrete time of
        F'Y F - Y. The sign of a stable loop is -1.
        """
        product = self._right(self._one * -0.25) @ self.sign_function.sign
        return self.sign_function.lyapunov(_middle(product + product.T))


def change_along(loop: Any, Y: Any, *, is_discrete: bool) -> Any:
    """Return the change of z'Y z along z' = F z, F'Y + Y F, in discrete time F'Y F - Y."""
    if is_discrete:
        return loop.T @ (Y @ loop) - Y
    product = Y @ loop
    return product + product.T


def discounted(loop: arb_mat, game: Game) -> arb_mat:
    """Return √α times a loop, (n, n), on which the cost depends."""
    from flint import arb

    return loop if game.discount == 1.0 else loop * arb(game.discount).sqrt()


def loop_units(F: np.ndarray) -> np.ndarray:
    """Return units of the states, exponents of two, in which a loop is balanced, (n,) integers."""
    return np.round(np.log2(balanced(F)[1])).astype(int)


def lyapunov_in_bits(loop: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat:
    """Return a candidate for the solution of F'D + D F + C = 0, (n, n), in as many bits.

    In doubles, corrected by residuals in balls; in bits if they do not shrink. In discrete time,
    the equation is F'D F - D + C = 0.

    Raises FailedError.
    """
    F, C_middle = Balls(loop.mid()), Balls(C.mid())
    with suppress(FailedError):
        D = _refined(F, C_middle, is_discrete=is_discrete)
        if D is not None:
            return D.matrix
    return Lyapunov(F, is_discrete=is_discrete).solve(-C_middle).matrix


def _refined(F: Balls, C: Balls, *, is_discrete: bool) -> Balls | None:
    """Return D in doubles, corrected by residuals in balls as long as each is a tenth of the last,
    or None if the last one is not small.

    Raises FailedError.
    """
    solver, size_before = Lyapunov(F.midpoint, is_discrete=is_discrete), math.inf
    D = Balls.of(solver.solve(-C.midpoint))
    while True:
        residual = change_along(F, D, is_discrete=is_discrete) + C
        size = float(residual.mid().norm())
        if not size < size_before * 0.1:
            return D if size <= C.norm() * half_the_bits() else None
        size_before = size
        D = (D + Balls.of(solver.solve(-residual.midpoint))).mid()


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

    Let F'Y + Y F < 0, in discrete time F'Y F - Y < 0. F is stable if Y > 0, and not if Y is not,
    because Y would be positive definite if F were stable.

    loop: F, (n, n), balls
    """
    units = loop_units(midpoints(loop))
    F = Balls(scaled_balls(loop, -units, units))
    is_stable = None
    with suppress(FailedError), np.errstate(all="ignore"):
        in_doubles = DoubleBalls.of(F)
        is_stable = _by_shape(in_doubles, in_doubles.midpoint, is_discrete=is_discrete)
    if is_stable is None:
        with suppress(FailedError):
            is_stable = _by_shape(F, F.mid(), is_discrete=is_discrete)
    return is_stable


def _by_shape(F: Matrix, middle: Any, *, is_discrete: bool) -> bool | None:
    """Return whether a loop is stable by its Y, or None.

    Raises FailedError.
    """
    Y = symmetric_in(type(F), Lyapunov(middle, is_discrete=is_discrete).shape())
    if not (-change_along(F, Y, is_discrete=is_discrete)).is_positive_definite():
        return None
    exact = Y if isinstance(Y, Balls) else Balls.of(Y.midpoint)  # rounding Y may change its sign
    return True if Y.is_positive_definite() else is_positive_definite(exact.matrix)


def loop_with(game: Game, K: arb_mat) -> arb_mat:
    """Return A - B K in balls, (n, n)."""
    return ball_matrix(game.A) - ball_matrix(game.B) * K


def stabilizes(game: Game, K: np.ndarray, *, is_discounted: bool = False) -> bool:
    """Return whether A - B K is proved stable, or √α (A - B K); False without a proof.

    K: (m, n)
    is_discounted: whether √α (A - B K) is asked about
    """
    for attempt in ATTEMPTS:
        with precision(attempt):
            loop = loop_with(game, ball_matrix(K))
            loop = discounted(loop, game) if is_discounted else loop
            is_stable = stability_of(loop, is_discrete=game.is_discrete)
        if is_stable is not None:
            return is_stable
    return False
