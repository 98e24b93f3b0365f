"""Proof that a ball contains the stabilizing solution of a game, and that this is the value.

The checker takes nothing of the proposal but X and Y, in exact units. With the loop F of both
players at X, let F'Y + Y F ≈ -1 (in discrete time F'Y F - Y ≈ -1). If Y > 0 and the defect is below
1/4, F is stable, and a symmetric Z with F'Z + Z F + C = 0 has |Z| <= ζ Y for |C| <= 3/4 ζ. The
Riccati equation of X + Z is F'Z + Z F + r - q(Z) = 0, with the residual r of X. Thus, if
|r| + max |q(Z)| over |Z| <= ζ Y is at most 3/4 ζ, a solution is in X ± ζ Y (Brouwer), and if the
loop moves little, it is the stabilizing one.

Sources: Kantorovich; Miyajima, Journal of Computational and Applied Mathematics 319 (2017),
352-364; Haqiri and Poloni, the same 313 (2017), 515-535; Basar and Bernhard, H-infinity Optimal
Control, Theorems 3.7 and 4.11.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Generic

import numpy as np

from controller.riccati.balls import Balls, ExactMatrix, symmetric
from controller.riccati.equation import Bound, Equation, change_along

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Largest |F'Y + Y F + 1| of the loop F at X. With the 3/4 that remain, |Z| <= ζ Y.
DEFECT = 0.25


class NotProvedError(Exception):
    """Raised if a proposal does not prove what is asked, with the step that fails."""


@dataclass(frozen=True, eq=False)
class Stabilizing(Generic[Bound]):
    """Ball that contains the stabilizing solution P: the loop of both players is stable.

    exactly: the Riccati equation in the arithmetic of the residual and in exact units
    bounds: the same equation, in the arithmetic of the bounds
    middle: X, (n, n), exact
    spread: s, (n,); |P_ij - X_ij| <= s_i s_j
    all_gains: of P, (m, n), in discrete time (m + k, n), in the arithmetic of the residual
    """

    exactly: Equation[Any]
    bounds: Equation[Bound]
    middle: ExactMatrix
    spread: tuple[arb, ...]
    all_gains: ExactMatrix

    @cached_property
    def P(self) -> Bound:
        """P, (n, n), in the arithmetic of the bounds."""
        return self.bounds.arithmetic.around(self.middle, self.spread)

    @property
    def equation(self) -> Equation[Balls]:
        """The equation in `Balls`."""
        return self.exactly.with_arithmetic(Balls)

    @cached_property
    def X(self) -> arb_mat:
        """X in the arithmetic of FLINT, (n, n)."""
        return self.middle.matrix

    @cached_property
    def gains(self) -> arb_mat:
        """Gains of P in the arithmetic of FLINT."""
        return self.all_gains.matrix


def stabilizing(
    equation: Equation[Any], X: ExactMatrix, Y: arb_mat | np.ndarray, arithmetic: type[Bound]
) -> Stabilizing[Bound]:
    """Return the ball about X that is proved to contain the stabilizing solution.

    equation: the Riccati equation, in the arithmetic of X
    X: (n, n), proposed solution; only the midpoint of its symmetric part counts
    Y: (n, n), proposed solution of F'Y + Y F = -1, in discrete time F'Y F - Y = -1, likewise
    arithmetic: of the bounds

    Raises NotProvedError if the proposal does not prove it.
    """
    bounds = equation.with_arithmetic(arithmetic)
    X = X.symmetric()
    try:
        gains, residual = equation.gains_and_residual(X)
    except ZeroDivisionError:
        raise NotProvedError("the price at X may be singular") from None
    Y = (Y + Y.T) / 2.0 if isinstance(Y, np.ndarray) else symmetric(Y)
    middle, shape = arithmetic.of(X), arithmetic.of(Y)
    loop = bounds.loop(middle, arithmetic.of(gains))
    if not proves_stable(loop, shape, DEFECT, is_discrete=bounds.is_discrete):
        raise NotProvedError("the loop of both players at X")
    size, rho = shape.norm(), arithmetic.of(residual).norm()
    zeta = 4 * rho
    farthest = zeta * size  # |Z| is at most this
    sensitivity = bounds.sensitivity(middle, loop)
    moved = sensitivity.loop * farthest  # bound of the change of the loop
    through = loop.norm() if equation.is_discrete else 1
    is_near = sensitivity.price * farthest <= 0.5
    if not (is_near and rho + farthest * moved * through <= 0.75 * zeta):
        raise NotProvedError("the residual of X")
    twice = 2 * through + moved if equation.is_discrete else 2
    if not size * moved * twice < 0.5:  # with the defect, less than 1
        raise NotProvedError("the loop of both players near X")
    spread = tuple((zeta * Y[i, i]).sqrt().upper() for i in range(equation.n))
    of_gains = sensitivity.gains * sum((each**2 for each in spread), zeta * 0).sqrt()
    changed = gains.wider([of_gains * each for each in spread])
    return Stabilizing(equation, bounds, X, spread, changed)


def prove_value(found: Stabilizing[Bound], Y: arb_mat | None = None) -> None:
    """Prove that the stabilizing solution P is the value of the game.

    The disturbance pays: in discrete time, δ² - E'P E > 0. The loop without disturbance is stable.
    Then P >= 0, because P is a cost of this loop if the weights are positive semidefinite. If
    P > 0, that loop is stable because the loop of both players is. The input pays in any case:
    R + B'P B >= 0, and P has gains only if it is not singular.

    Y: as in `stabilizing`, for the loop without disturbance; needed if P is singular

    Raises NotProvedError if the ball and Y do not prove it.
    """
    bounds = found.bounds
    price = bounds.disturbance_price(found.P)
    if price is not None and not price.is_positive_definite():
        raise NotProvedError("the disturbance pays")
    if not bounds.is_disturbed or found.P.is_positive_definite():
        return
    if Y is None:
        raise NotProvedError("P > 0")
    arithmetic = bounds.arithmetic
    control = bounds.control_loop(found.P, arithmetic.of(found.all_gains))
    if not proves_stable(control, arithmetic.of(symmetric(Y)), 1, is_discrete=bounds.is_discrete):
        raise NotProvedError("the loop without disturbance")


def proves_stable(loop: Bound, Y: Bound, most: float = 1.0, *, is_discrete: bool) -> bool:
    """Return whether Y proves a loop F stable: Y > 0 and |F'Y + Y F + 1| < most <= 1.

    In discrete time, |F'Y F - Y + 1| < most.
    """
    one = type(Y).of(np.eye(Y.rows))
    defect = (change_along(loop, Y, is_discrete=is_discrete) + one).norm()
    return bool(defect < most) and Y.is_positive_definite()


def lyapunov_ball(
    loop: arb_mat, C: arb_mat, D: arb_mat, Y: arb_mat, *, is_discrete: bool
) -> arb_mat:
    """Return the ball about D that contains the solution of F'D + D F + C = 0, (n, n).

    In discrete time, the equation is F'D F - D + C = 0.

    loop: F, (n, n), balls
    C: (n, n), symmetric, balls
    D: (n, n), proposed solution; only the midpoint of its symmetric part counts
    Y: (n, n), proposed solution for C = 1, likewise

    Raises NotProvedError if Y does not prove that F is stable.
    """
    F, shape, D = Balls(loop), Balls(symmetric(Y)), symmetric(D)
    # With a defect below 1/2, F'Y + Y F < -1/2. The error Z of D solves F'Z + Z F + residual = 0.
    # Therefore ζ Y ± Z, with ζ = 2 |residual|, are costs of the stable F of weights
    # > |residual| ± residual >= 0. From -ζ Y <= Z <= ζ Y follows |Z_ij|² <= ζ² Y_ii Y_jj: the
    # radius of entry ij is the product of √(ζ Y_ii) and √(ζ Y_jj). Likewise in discrete time.
    if not proves_stable(F, shape, 0.5, is_discrete=is_discrete):
        raise NotProvedError("the loop")
    residual = change_along(F, Balls(D), is_discrete=is_discrete) + Balls(C)
    zeta = 2 * residual.norm()
    spread = [(zeta * shape.matrix[i, i]).sqrt().upper() for i in range(D.nrows())]
    return Balls.around(D, spread).matrix
