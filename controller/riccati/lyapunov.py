"""Lyapunov equations F'Z + Z F = C, in discrete time F'Z F - Z = C, and what they prove of loops.

Candidate solutions are computed in doubles or in many bits; balls prove what follows from them. F
is a loop, Z, Y and D are solutions, C is a right side: all (n, n), the latter symmetric. M is a
matrix whose eigenvalues have Re λ < 0 where F is stable: F, or its transform in discrete time.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ATTEMPTS,
    Near,
    ball_matrix,
    bits,
    identity,
    is_positive_definite,
    midpoints,
    norm,
    precision,
    scaled,
    symmetric,
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


#: Matrix of a candidate: in doubles, or in the bits of `precision`, of which only midpoints count.
Middle = TypeVar("Middle", "arb_mat", np.ndarray)


class SignFunction(Generic[Middle]):
    """Sign of a matrix M, by Newton's method, (c M + (c M)⁻¹)/2 in each step.

    sign: -1 on the stable subspace of M, and 1 on the unstable one
    stable: number of eigenvalues with Re λ < 0

    Raises FailedError if it does not converge.
    Source: Roberts, International Journal of Control 32 (1980), 677-687.
    """

    sign: Middle
    stable: int

    def __init__(self, matrix: Middle) -> None:
        self._steps: list[tuple[float, Middle]] = []  # c and M⁻¹ in each step
        in_doubles = isinstance(matrix, np.ndarray)
        accuracy = HALF_THE_DIGITS if in_doubles else half_the_bits()
        size = _size(matrix)
        for step in range(NEWTON_STEPS):
            inverse = _inverse(matrix)
            # This factor brings the eigenvalues near ±1 soon.
            c = float((_size(inverse) / size) ** 0.5)
            if not 0.0 < c < math.inf:
                raise FailedError("the sign is not finite")
            # Then, steps without a factor converge quadratically. Factors that stay far from 1 are
            # left out in the second half of the steps.
            is_near = 0.9 < c < 1.1 or step > NEWTON_STEPS // 2
            c = 1.0 if is_near else c
            self._steps.append((c, inverse))
            before, matrix = matrix, (matrix * c + inverse * (1.0 / c)) * 0.5
            size = _size(matrix)
            if is_near and _size(matrix - before) <= accuracy * size:
                break
        else:
            raise FailedError("an eigenvalue may be on the axis")
        self.sign = matrix
        self.stable = round(float((one_of(matrix) - matrix).trace()) / 2.0)

    def lyapunov(self, C: Middle) -> Middle:
        """Return D with M'D + D M = C sign + sign'C, (n, n), for a symmetric C.

        The sign of [[M, 0], [C, -M']] is [[sign, 0], [D, -sign']].
        """
        D = C
        # Newton's steps of this block matrix: its diagonal has the steps of M, so only the block
        # D is computed.
        for c, inverse in self._steps:
            D = (D * c + product(inverse.transpose(), D, inverse) * (1.0 / c)) * 0.5
        return (D + D.transpose()) * 0.5


def product(*factors: Any) -> Any:
    """Return the product of matrices of doubles, or of matrices in bits without radii."""
    result = factors[0]
    for factor in factors[1:]:
        result = result @ factor if isinstance(factor, np.ndarray) else (result * factor).mid()
    return result


def one_of(matrix: Any) -> Any:
    """Return the identity of the size of a square matrix."""
    return np.eye(len(matrix)) if isinstance(matrix, np.ndarray) else identity(matrix.nrows())


def _size(matrix: Any) -> Any:
    """Return the norm of Frobenius, in doubles or as an exact ball."""
    return np.vdot(matrix, matrix) ** 0.5 if isinstance(matrix, np.ndarray) else norm(matrix)


def _inverse(matrix: Any) -> Any:
    """Return the inverse without radii.

    Raises FailedError if the matrix may be singular.
    """
    try:
        if isinstance(matrix, np.ndarray):
            return np.linalg.inv(matrix)
        return matrix.mid().inv().mid()
    except (ZeroDivisionError, np.linalg.LinAlgError):
        raise FailedError("a matrix is singular") from None


class Lyapunov(Generic[Middle]):
    """Solver of F'Z + Z F = C, in discrete time of F'Z F - Z = C, for one loop F, (n, n).

    In discrete time, with W = (F + 1)⁻¹, Z solves M'Z + Z M = 2 W'C W with M = (F - 1) W.

    Raises FailedError if an eigenvalue of F may be on the boundary of stability.
    """

    def __init__(self, F: Middle, *, is_discrete: bool) -> None:
        self._one = one_of(F)
        self._to_rates: Any = _inverse(F + self._one) if is_discrete else None
        of_rates = product(F - self._one, self._to_rates) if is_discrete else F
        self.sign_function: SignFunction[Middle] = SignFunction(of_rates)

    def _right_side(self, C: Middle) -> Middle:
        """Return the right side for M: C, in discrete time 2 W'C W."""
        return (
            C
            if self._to_rates is None
            else product(self._to_rates.transpose(), C, self._to_rates) * 2.0
        )

    def solve(self, C: Middle) -> Middle:
        """Return Z, (n, n), symmetric.

        Raises FailedError if F is not stable.
        """
        n = round(float(self._one.trace()))  # for either kind of matrix
        if self.sign_function.stable != n:
            raise FailedError("the loop is not stable")
        return self.sign_function.lyapunov(self._right_side(C)) * -0.5  # C sign + sign'C = -2 C

    def decreasing_form(self) -> Middle:
        """Return Y, (n, n), symmetric, for which z'Y z decreases along z' = F z.

        F'Y + Y F, in discrete time F'Y F - Y, is -(1 + sign'sign)/2, which is -1 for a stable loop.
        """
        # C = -(sign + sign')/4 gives C sign + sign'C = -(1 + sign'sign)/2, as sign² is 1.
        half_of_C = product(self._right_side(self._one * -0.25), self.sign_function.sign)
        return self.sign_function.lyapunov(half_of_C + half_of_C.transpose())


def change_along(loop: Any, Y: Any, *, is_discrete: bool) -> Any:
    """Return the change of z'Y z along z' = F z, F'Y + Y F, in discrete time F'Y F - Y."""
    if is_discrete:
        return loop.transpose() * (Y * loop) - Y
    YF = Y * loop
    return YF + YF.transpose()


def solved_in_bits(F: arb_mat, C: arb_mat, *, is_discrete: bool) -> arb_mat:
    """Return a candidate for D of F'D + D F + C = 0, in discrete time of F'D F - D + C = 0.

    It is solved in doubles, or in bits if the residual may be more than a millionth of C.

    F, C: (n, n), of which only the midpoints count

    Raises FailedError.
    """
    of_F, of_C = midpoints(F), midpoints(C)
    with suppress(FailedError), np.errstate(all="ignore"):
        D = Lyapunov(of_F, is_discrete=is_discrete).solve(-of_C)
        residual = change_along(Near(of_F), Near(D), is_discrete=is_discrete) + Near(of_C)
        if residual.size < 1e-6 * np.linalg.norm(of_C):
            return ball_matrix(D)
    return Lyapunov(F.mid(), is_discrete=is_discrete).solve(-C.mid())


def discounted(loop: arb_mat, game: Game) -> arb_mat:
    """Return √α times a loop, (n, n), on which the cost depends."""
    from flint import arb

    return loop if game.discount == 1.0 else loop * arb(game.discount).sqrt()


def loop_units(F: np.ndarray) -> np.ndarray:
    """Return units of the states, exponents of two, in which a loop is balanced, (n,) integers."""
    return np.round(np.log2(balanced(F)[1])).astype(int)


def half_the_bits() -> arb:
    """Return 2^(-bits/2): after a Newton step as small, the next is exact up to the last bits."""
    from flint import arb

    return arb(2) ** (-bits() // 2)


def stability_of(loop: Any, *, is_discrete: bool) -> bool | None:
    """Return whether a loop F is stable, or None if the bits of `precision` do not prove it.

    Let F'Y + Y F < 0, in discrete time F'Y F - Y < 0. F is stable if Y > 0, and not if Y is not,
    because Y would be positive definite if F were stable. Y is sought in doubles, then in bits.

    loop: F, (n, n), balls, or `Near`: then in doubles alone
    """
    loops = [loop]
    if not isinstance(loop, Near):
        units = loop_units(midpoints(loop))
        F = scaled(loop, -units, units)
        loops = [Near.of(F), F]
    for F in loops:
        with suppress(FailedError), np.errstate(all="ignore"):
            middle: Any = F.middle if isinstance(F, Near) else F.mid()
            form = Lyapunov(middle, is_discrete=is_discrete).decreasing_form()
            Y = Near(form) if isinstance(form, np.ndarray) else symmetric(form)
            if is_positive_definite(-change_along(F, Y, is_discrete=is_discrete)):
                is_stable = is_positive_definite(Y)
                if is_stable is None and isinstance(Y, Near):
                    is_stable = is_positive_definite(ball_matrix(Y))
                if is_stable is not None:
                    return is_stable
    return None


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
