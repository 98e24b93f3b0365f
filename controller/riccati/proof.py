"""Proof that a ball contains the stabilizing solution of a game, and that this is the value.

The checker takes nothing of the proposal but X and Y, in exact units.

1. Stability. Let F be the loop of both players at X, and F'Y + Y F ≈ -1 (in discrete time
   F'Y F - Y ≈ -1). If Y > 0 and the defect |F'Y + Y F + 1| is below 1/4, F is stable, as y'Y y is a
   Lyapunov function.
2. Existence. Of the linear equation F'Z + Z F + C = 0 with |C| <= 3/4 ζ, the solution has
   -ζ Y <= Z <= ζ Y, written |Z| <= ζ Y. The Riccati equation of X + Z is the nonlinear one with
   C = r - q(Z), of the residual r of X and of terms q(Z) of second order. If |r| + |q(Z)| <= 3/4 ζ
   for all |Z| <= ζ Y, this set is mapped into itself, and contains a solution (Brouwer).
3. If the loop changes little between X and X + Z, the solution is the stabilizing one.

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
from controller.riccati.equation import Bound, Equation, Sensitivity, change_along

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Largest |F'Y + Y F + 1| of the loop F at X. With the 3/4 that remain, |Z| <= ζ Y.
DEFECT = 0.25


class NotProvedError(Exception):
    """Raised if a proposal does not prove what is asked, with the step that fails."""


@dataclass(frozen=True, eq=False)
class Stabilizing(Generic[Bound]):
    """Ball that contains the stabilizing solution P: the loop of both players is stable.

    bounds: the Riccati equation in exact units, in the arithmetic of the bounds
    X: middle of the ball, (n, n), exact, in the arithmetic of the residual
    spread: s, (n,); |P_ij - X_ij| <= s_i s_j
    gains: of P, (m, n), in discrete time (m + k, n), in the arithmetic of the residual
    """

    bounds: Equation[Bound]
    X: ExactMatrix
    spread: tuple[arb, ...]
    gains: ExactMatrix

    @cached_property
    def P(self) -> Bound:
        """P, (n, n), in the arithmetic of the bounds."""
        return self.bounds.arithmetic.around(self.X, self.spread)

    @property
    def P_in_balls(self) -> Balls:
        """P, (n, n), in `Balls`, with the bits of `precision`."""
        return Balls.around(self.X, self.spread)

    @property
    def K(self) -> ExactMatrix:
        """K of the policy u = -K z, (m, n), in the arithmetic of the residual."""
        return self.gains.block(slice(len(self.bounds.units.inputs)), slice(None))

    @property
    def equation(self) -> Equation[Balls]:
        """The Riccati equation of `bounds`, in `Balls`."""
        return self.bounds.with_arithmetic(Balls)


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
    middle = arithmetic.of(X)
    loop = bounds.loop(middle, arithmetic.of(gains))
    sensitivity = bounds.sensitivity(middle, loop)
    residual_norm = arithmetic.of(residual).norm()
    zeta = proved_zeta(
        loop, arithmetic.of(Y), residual_norm, sensitivity, is_discrete=bounds.is_discrete
    )
    spread = tuple((zeta * Y[i, i]).sqrt().upper() for i in range(bounds.n))
    root_of_trace = sum((radius**2 for radius in spread), zeta * 0).sqrt()
    of_gains = sensitivity.gains * root_of_trace
    return Stabilizing(bounds, X, spread, gains.wider([of_gains * radius for radius in spread]))


def proved_zeta(
    loop: Bound, Y: Bound, residual_norm: arb, sensitivity: Sensitivity, *, is_discrete: bool
) -> arb:
    """Return ζ for which the stabilizing solution is proved to be X + Z with -ζ Y <= Z <= ζ Y.

    loop: F of both players at X, (n, n)
    Y: proposed solution of F'Y + Y F = -1, in discrete time F'Y F - Y = -1, (n, n), symmetric
    residual_norm: bound of the residual of X
    sensitivity: of the loop to changes of X

    Raises NotProvedError if the proposal does not prove it.
    """
    if not proves_stable(loop, Y, DEFECT, is_discrete=is_discrete):
        raise NotProvedError("the loop of both players at X")
    size = Y.norm()
    zeta = 4 * residual_norm
    largest_change = zeta * size  # of X
    loop_change = sensitivity.loop * largest_change
    if not sensitivity.price * largest_change <= 0.5:
        raise NotProvedError("the price near X")
    # The loop F + G of X + Z has the defect of F and |G'Y + Y G|, in discrete time
    # |G'Y F + F'Y G + G'Y G|: less than 1 together. Half of the latter, times ζ, bounds q(Z), as
    # |q(Z)| <= |Z| |G|, in discrete time |Z| |G| |F|: |r| + |q(Z)| is then at most 1/2 ζ.
    twice_through = 2 * loop.norm() + loop_change if is_discrete else 2
    if not size * loop_change * twice_through < 0.5:
        raise NotProvedError("the loop of both players near X")
    return zeta


def prove_value(found: Stabilizing[Bound], Y: arb_mat | None = None) -> None:
    """Prove that the stabilizing solution P is the value of the game.

    First, the disturbance pays: in discrete time, δ² - E'P E > 0. Second, the loop without
    disturbance is stable: P > 0 proves it, because the loop of both players is stable, otherwise
    Y does. Then P >= 0, because P is a cost of this loop if the weights are positive semidefinite.
    The input pays in any case: R + B'P B >= 0, and P has gains only if it is not singular.

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
    control = bounds.control_loop(found.P, arithmetic.of(found.gains))
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
    """Return the ball about D that contains the solution of F'D + D F + C = 0, (n, n), proved.

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
