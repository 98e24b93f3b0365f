"""Proof that a ball contains the stabilizing solution of a game, and that this is the value.

The value is that of policies under which the state goes to 0: the infimum over them of the largest
cost that a disturbance causes. Q, R and N need not be semidefinite. z'P z is the value, and
(-K z, L z) a saddle point, if

(a) there is a stabilizing solution for delta = inf, of LQR, with R + B'P B > 0: without it, the
    cost may have no lower bound. Where [[Q, N], [N', R]] >= 0, it follows from (c);
(b) P is the stabilizing solution at delta: A - B K + E L is stable;
(c) A - B K is stable;
(d) R + B'P B > 0, in continuous time R > 0, and in discrete time δ² - E'P E > 0.

For, with (b) to (d), completed squares give at most z'P z for K, and z'P z for K and L. Values of
finite horizons with the terminal weight P of (a), P0, grow with the horizon, stay below P, and are
lower bounds. Their limit solves the equation, is at least P0, and its loop is stable as that of P0
is: it stabilizes, and is P.

The checker takes nothing of the candidate but X and Y, in exact units.

1. Stability. Let F be the loop of both players at X, and F'Y + Y F ≈ -1 (in discrete time
   F'Y F - Y ≈ -1). If Y > 0 and the defect |F'Y + Y F + 1| is below 1/4, F is stable, as y'Y y is a
   Lyapunov function.
2. Existence. Of the linear equation F'Z + Z F + C = 0 with |C| <= 3/4 ζ, the solution has
   -ζ Y <= Z <= ζ Y, written |Z| <= ζ Y. The Riccati equation of X + Z is the nonlinear one with
   C = r - q(Z), of the residual r of X and of terms q(Z) of second order. If |r| + |q(Z)| <= 3/4 ζ
   for all |Z| <= ζ Y, this set is mapped into itself, and contains a solution (Brouwer).
3. If the loop changes little between X and X + Z, the solution is the stabilizing one.
4. A - B K is proved stable by a Y of its own for the whole ball, and so are the prices of (d).

Sources: Willems, IEEE Transactions on Automatic Control 16 (1971), 621-634; Molinari, the same 22
(1977), 396-399; Kantorovich; Miyajima, Journal of Computational and Applied Mathematics 319 (2017),
352-364; Haqiri and Poloni, the same 313 (2017), 515-535; Basar and Bernhard, H-infinity Optimal
Control, Theorems 3.7, 4.8 and 4.11.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Generic

import numpy as np

from controller.riccati.balls import UNDERFLOW, UP, Balls, Matrix
from controller.riccati.equation import Equation, Sensitivity
from controller.riccati.lyapunov import NotProvedError, proves_stable, symmetric_in

if TYPE_CHECKING:
    from flint import arb

#: Largest |F'Y + Y F + 1| of the loop F at X. With the 3/4 that remain, |Z| <= ζ Y.
DEFECT = 0.25


@dataclass(frozen=True, eq=False)
class Stabilizing(Generic[Matrix]):
    """Ball that contains the stabilizing solution P: the loop of both players is stable.

    bounds: the Riccati equation in exact units, in the arithmetic of the bounds
    X: middle of the ball, (n, n), exact
    spread: s, (n,); |P_ij - X_ij| <= s_i s_j
    gains: of P, (m, n), in discrete time (m + k, n)
    """

    bounds: Equation[Matrix]
    X: Balls
    spread: tuple[arb, ...]
    gains: Balls

    @cached_property
    def P(self) -> Matrix:
        """P, (n, n), in the arithmetic of the bounds."""
        return self.bounds.arithmetic.around(self.X, self.spread)

    @cached_property
    def control_loop(self) -> Matrix:
        """A - B K, (n, n), in the arithmetic of the bounds."""
        return self.bounds.control_loop(self.P, self.bounds.arithmetic.of(self.gains))

    @property
    def P_in_balls(self) -> Balls:
        """P, (n, n), in `Balls`, with the bits of `precision`."""
        return Balls.around(self.X, self.spread)

    @property
    def K(self) -> Balls:
        """K of the policy u = -K z, (m, n)."""
        return self.gains.block(slice(len(self.bounds.units.inputs)), slice(None))

    @property
    def equation(self) -> Equation[Balls]:
        """The Riccati equation of `bounds`, in `Balls`."""
        return self.bounds.with_arithmetic(Balls)


def stabilizing(
    equation: Equation[Balls], X: Balls, Y: Balls | np.ndarray, arithmetic: type[Matrix]
) -> Stabilizing[Matrix]:
    """Return the ball about X that is proved to contain the stabilizing solution.

    equation: the Riccati equation
    X: (n, n), candidate solution; only the midpoint of its symmetric part counts
    Y: (n, n), candidate solution of F'Y + Y F = -1, in discrete time F'Y F - Y = -1, likewise
    arithmetic: of the bounds

    Raises NotProvedError if the candidate does not prove it.
    """
    bounds = equation.with_arithmetic(arithmetic)
    X = X.symmetric()
    try:
        gains, residual = equation.gains_and_residual(X)
    except ZeroDivisionError:
        raise NotProvedError("the price at X may be singular") from None
    middle, shape = arithmetic.of(X), symmetric_in(arithmetic, Y)
    loop = bounds.loop(middle, arithmetic.of(gains))
    sensitivity = bounds.sensitivity(middle, loop)
    residual_norm = arithmetic.of(residual).norm()
    zeta = proved_zeta(loop, shape, residual_norm, sensitivity, is_discrete=bounds.is_discrete)
    diagonal = UP * np.diag(shape.midpoint) + UNDERFLOW
    spread = tuple((zeta * size).sqrt().upper() for size in diagonal.tolist())
    root_of_trace = sum((radius**2 for radius in spread), zeta * 0).sqrt()
    of_gains = sensitivity.gains * root_of_trace
    return Stabilizing(bounds, X, spread, gains.wider([of_gains * radius for radius in spread]))


def proved_zeta(
    loop: Matrix, Y: Matrix, residual_norm: arb, sensitivity: Sensitivity, *, is_discrete: bool
) -> arb:
    """Return ζ for which the stabilizing solution is proved to be X + Z with -ζ Y <= Z <= ζ Y.

    loop: F of both players at X, (n, n)
    Y: candidate solution of F'Y + Y F = -1, in discrete time F'Y F - Y = -1, (n, n), symmetric
    residual_norm: bound of the residual of X
    sensitivity: of the loop to changes of X

    Raises NotProvedError if the candidate does not prove it.
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


def prove_prices(found: Stabilizing[Matrix]) -> None:
    """Prove that both players pay: R + B'P B > 0, in continuous time R > 0, and δ² - E'P E > 0.

    Raises NotProvedError if the ball does not prove it.
    """
    bounds = found.bounds
    for price in (bounds.input_price(found.P), bounds.disturbance_price(found.P)):
        if price is not None and not price.is_positive_definite():
            raise NotProvedError("a player pays")


def prove_control_loop(found: Stabilizing[Matrix], Y: Balls | np.ndarray) -> None:
    """Prove that the loop without disturbance, A - B K, is stable, for all P of the ball.

    Y: as in `stabilizing`, for that loop

    Raises NotProvedError if Y does not prove it.
    """
    shape = symmetric_in(found.bounds.arithmetic, Y)
    if not proves_stable(found.control_loop, shape, is_discrete=found.bounds.is_discrete):
        raise NotProvedError("the loop without disturbance")
