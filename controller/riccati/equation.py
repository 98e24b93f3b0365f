"""The Riccati equation of a game with the game's exact entries, in balls of any arithmetic."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    BallMatrix,
    Balls,
    BoundMatrix,
    ball_matrix,
    identity,
    stacked,
    symmetric_part,
)

if TYPE_CHECKING:
    from flint import arb, arb_mat

Matrix = TypeVar("Matrix", bound=BallMatrix)
Other = TypeVar("Other", bound=BallMatrix)
Bound = TypeVar("Bound", bound=BoundMatrix)


class Units(NamedTuple):
    """Units of the states, inputs and disturbances as exponents of two: z_i = 2^states_i y_i.

    states: (n,) integers
    inputs: (m,) integers
    disturbances: (k,) integers
    """

    states: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray


def users_units(game: Game) -> Units:
    """Return the units of a game as the user gave it."""
    return Units(*(np.zeros(size, dtype=int) for size in (*game.B.shape, game.E.shape[1])))


def scaled(
    matrix: np.ndarray | arb_mat, rows: np.ndarray, columns: np.ndarray
) -> np.ndarray | arb_mat:
    """Return 2^rows_i M_ij 2^columns_j exactly, in balls if doubles over- or underflow.

    rows, columns: (n,) and (m,) integers
    """
    if not isinstance(matrix, np.ndarray):
        return scaled_balls(matrix, rows, columns)
    if not (rows.any() or columns.any()):
        return matrix
    powers = np.add.outer(rows, columns)
    with np.errstate(all="ignore"):
        result = np.ldexp(matrix, powers)
        is_exact = np.array_equal(np.ldexp(result, -powers), matrix)
    if is_exact and np.isfinite(result).all():
        return result
    return scaled_balls(ball_matrix(matrix), rows, columns)


def scaled_balls(matrix: arb_mat, rows: np.ndarray, columns: np.ndarray) -> arb_mat:
    """Return 2^rows_i M_ij 2^columns_j in balls, exactly if their bits suffice for the entries.

    rows, columns: (n,) and (m,) integers
    """
    from flint import arb

    if not rows.any() and not columns.any():
        return matrix
    left, right = ([arb(2) ** int(power) for power in powers] for powers in (rows, columns))
    entries = iter(matrix.entries())
    return ball_matrix([[next(entries) * i * j for j in right] for i in left])


@dataclass(frozen=True, eq=False)
class Entries:
    """Matrices of a game in exact units, without discount, in balls where doubles overflow."""

    A: np.ndarray | arb_mat
    B: np.ndarray | arb_mat
    E: np.ndarray | arb_mat
    Q: np.ndarray | arb_mat
    R: np.ndarray | arb_mat
    N: np.ndarray | arb_mat

    @classmethod
    def of(cls, game: Game, units: Units) -> Entries:
        """Return the matrices of a game."""
        z, u, d = units
        return cls(
            scaled(game.A, -z, z),
            scaled(game.B, -z, u),
            scaled(game.E, -z, d),
            _symmetric(game.Q, z),
            _symmetric(game.R, u),
            scaled(game.N, z, u),
        )

    def in_states(self, T: arb_mat) -> Entries:
        """Return the matrices in the states T z, in balls.

        T: (n, n), exact

        Raises ZeroDivisionError if T may be singular with the bits of `precision`.
        """
        A, B, E, Q, N = map(_balls, (self.A, self.B, self.E, self.Q, self.N))
        back = T.inv()
        down = back.transpose()
        return Entries(
            T * A * back, T * B, T * E, symmetric_part(down * Q * back), self.R, down * N
        )

    @property
    def rounded(self) -> Entries:
        """The matrices in doubles."""
        exact = self.A, self.B, self.E, self.Q, self.R, self.N
        return Entries(*(Balls.of(each).midpoint for each in exact))

    @cached_property
    def R_inverse(self) -> arb_mat:
        """R⁻¹, (m, m), in the arithmetic of FLINT.

        Raises ZeroDivisionError if R is singular.
        """
        return _balls(self.R).inv()


class Sensitivity(NamedTuple):
    """Bounds of the changes if X is changed by a symmetric Z, (n, n), with price |Z| <= 1/2.

    loop: |change of the loop F of both players| <= loop |Z|
    gains: if |Z| <= Y and F'Y F <= Y, in discrete time, |change of column j of the gains| is at
        most gains |s| s_j, with the roots s of the diagonal of Y
    price: in discrete time, relative change of the price W + G'X G <= price |Z|; otherwise 0
    """

    loop: arb
    gains: arb
    price: arb


class Equation(ABC, Generic[Matrix]):
    """Riccati equation of a game in exact units, whose matrices are balls of one arithmetic.

    game: the game
    units: exact units
    arithmetic: `Balls`, `Pairs`, or, for bounds, `DoubleBalls`
    delta: in place of that of the game

    A, B, E, Q, R, N: of the arithmetic. The discount is taken into √α A, √α B and √α E.
    w: 1 / delta², 0 without a disturbance
    """

    is_discrete: ClassVar[bool]

    def __init__(
        self,
        game: Game,
        units: Units,
        arithmetic: type[Matrix],
        delta: float | None = None,
        entries: Entries | None = None,
    ) -> None:
        from flint import arb

        self._others: dict[type[Any], Equation[Any]] = {arithmetic: self}
        self._last: tuple[Matrix, Matrix, Matrix] | None = None
        self.game = game
        self.units = units
        self.arithmetic = arithmetic
        self.delta = game.delta if delta is None else delta
        self.entries = entries or Entries.of(game, units)
        exact = self.entries

        def rates(matrix: np.ndarray | arb_mat) -> Matrix:
            found = arithmetic.of(matrix)
            return found if game.discount == 1.0 else found.times(arb(game.discount).sqrt())

        self.n = len(game.A)
        self.is_disturbed = math.isfinite(self.delta) and bool(game.E.any())
        self.w = 1 / arb(self.delta) ** 2 if self.is_disturbed else arb(0)
        self.A, self.B, self.E = rates(exact.A), rates(exact.B), rates(exact.E)
        self.Q, self.R, self.N = map(arithmetic.of, (exact.Q, exact.R, exact.N))

    def with_arithmetic(self, arithmetic: type[Other]) -> Equation[Other]:
        """Return the same equation in another arithmetic."""
        if arithmetic not in self._others:
            other = equation_of(self.game, self.units, arithmetic, self.delta, self.entries)
            other._others = self._others | other._others
            self._others[arithmetic] = other
        return self._others[arithmetic]

    def gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return the gains of X and the residual of the Riccati equation.

        Those of the last X are kept. The digits of the residual cancel: doubles do not suffice.

        X: (n, n)

        Raises ZeroDivisionError if the price of the inputs or of the disturbances may be singular.
        """
        last = self._last
        if last is None or last[0] is not X:
            self._last = last = (X, *self._gains_and_residual(X))
        return last[1:]

    @abstractmethod
    def _gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]: ...

    @abstractmethod
    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return the loop of both players, (n, n).

        gains: of X
        """

    @abstractmethod
    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return the loop without disturbance, (n, n)."""

    @abstractmethod
    def disturbance_price(self, X: Matrix) -> Matrix | None:
        """Return δ² - E'X E, (k, k), of discrete time, which must be positive definite."""

    @abstractmethod
    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return bounds of the changes of the loop and the gains at X.

        loop: of both players at X
        """


def change_along(loop: Matrix, Y: Matrix, *, is_discrete: bool) -> Matrix:
    """Return the change F'Y + Y F of z'Y z along a loop F, in discrete time F'Y F - Y."""
    if is_discrete:
        return loop.T @ (Y @ loop) - Y
    product = Y @ loop
    return product + product.T


def _symmetric(weights: np.ndarray, units: np.ndarray) -> np.ndarray | arb_mat:
    """Return the exact symmetric part of weights in exact units."""
    exact = scaled(weights, units, units)
    if np.array_equal(weights, weights.T):
        return exact
    return symmetric_part(_balls(exact))


def _balls(matrix: np.ndarray | arb_mat) -> arb_mat:
    return ball_matrix(matrix) if isinstance(matrix, np.ndarray) else matrix


class ContinuousEquation(Equation[Matrix]):
    """A'X + X A + Q - (X B + N) R⁻¹ (B'X + N') + w X E E'X = 0.

    The gain of X is R⁻¹ (B'X + N'), and the loop of both players is A - B R⁻¹ N' - S X with
    S = B R⁻¹ B' - w E E'.
    """

    is_discrete = False

    @cached_property
    def R_inverse(self) -> Matrix:
        """R⁻¹, (m, m)."""
        return self.arithmetic.of(self.entries.R_inverse)

    @cached_property
    def of_control(self) -> Matrix:
        """B R⁻¹ B', (n, n)."""
        return self._B_over_R @ self.B.T

    @cached_property
    def of_disturbance(self) -> Matrix:
        """w E E', (n, n)."""
        return (self.E @ self.E.T).times(self.w)

    @cached_property
    def S(self) -> Matrix:
        """B R⁻¹ B' - w E E', (n, n)."""
        return self.of_control - self.of_disturbance if self.is_disturbed else self.of_control

    @cached_property
    def free(self) -> Matrix:
        """A - B R⁻¹ N', (n, n)."""
        return self.A - self._B_over_R @ self.N.T if self.game.N.any() else self.A

    @cached_property
    def cost(self) -> Matrix:
        """Q - N R⁻¹ N', (n, n)."""
        return self.Q - self.N @ self.R_inverse @ self.N.T if self.game.N.any() else self.Q

    @cached_property
    def _B_over_R(self) -> Matrix:
        return self.B @ self.R_inverse

    def _gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return the gain (m, n) and the residual (n, n) of X."""
        priced = self.B.T @ X
        if self.game.N.any():
            priced = priced + self.N.T
        gain = self.R_inverse @ priced
        driven = X @ self.A
        residual = driven + driven.T + self.Q - priced.T @ gain
        if self.is_disturbed:
            worst = self.E.T @ X
            residual = residual + worst.T @ worst.times(self.w)
        return gain, residual

    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B R⁻¹ N' - S X."""
        return self.free - self.S @ X

    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B R⁻¹ N' - B R⁻¹ B'X."""
        return self.free - self.of_control @ X

    def disturbance_price(self, X: Matrix) -> None:
        """Return None: in continuous time, d costs δ²."""

    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return |S|, |R⁻¹ B'| and 0: the equation is quadratic."""
        from flint import arb

        S, B_over_R = map(_bound, (self.S, self._B_over_R))
        return Sensitivity(S.norm(), B_over_R.norm(), arb(0))

    def hamiltonian(self) -> arb_mat:
        """Return [[A - B R⁻¹N', -S], [-(Q - N R⁻¹N'), -(A - B R⁻¹N')']], (2n, 2n), in `Balls`."""
        free, S, cost = (_of(each) for each in (self.free, self.S, self.cost))
        return stacked([[free, -S], [-cost, -free.transpose()]])


class StepEquation(Equation[Matrix]):
    """A'X A - X + Q - (A'X G + C) (W + G'X G)⁻¹ (G'X A + C') = 0.

    G = [B E], W = blkdiag(R, -δ² I) and C = [N 0]. Without a disturbance, E has no columns.

    The gains of X are k = (W + G'X G)⁻¹ (G'X A + C'), and the loop of both players is A - G k.
    """

    is_discrete = True

    @cached_property
    def G(self) -> Matrix:
        """[B E], (n, m + k)."""
        return self.B.beside(self.E) if self.is_disturbed else self.B

    @cached_property
    def W(self) -> Matrix:
        """blkdiag(R, -δ² I), (m + k, m + k)."""
        if not self.is_disturbed:
            return self.R
        m, k = self.R.rows, self.game.E.shape[1]
        d = self.units.disturbances
        price = self.arithmetic.of(np.ldexp(np.eye(k), np.add.outer(d, d))).times(-1 / self.w)
        nothing = self.arithmetic.of(np.zeros((k, m)))
        return self.R.beside(nothing.T).T.beside(nothing.beside(price).T).T

    @cached_property
    def C(self) -> Matrix:
        """[N 0], (n, m + k)."""
        if not self.is_disturbed:
            return self.N
        return self.N.beside(self.arithmetic.of(np.zeros(self.game.E.shape)))

    def _gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return the gains (m + k, n) and the residual (n, n) of X."""
        ahead = X @ self.A
        right = self.G.T @ ahead
        if self.game.N.any():
            right = right + self.C.T
        price: Any = self.price(X)
        gains = price.solve(right)
        # right'V⁻¹ right = k'right + error'V⁻¹ right for any k, with error = right - V k: what is
        # unknown of V⁻¹ right counts only with the error.
        k = gains.mid()
        error = right - price @ k
        return gains, self.A.T @ ahead - X + self.Q - k.T @ right - error.T @ gains

    def price(self, X: Matrix) -> Matrix:
        """Return W + G'X G, (m + k, m + k)."""
        return self.W + self.G.T @ (X @ self.G)

    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - G k."""
        return self.A - self.G @ gains

    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B K."""
        return self.A - self.B @ gains.block(slice(self.R.rows), slice(None))

    def disturbance_price(self, X: Matrix) -> Matrix | None:
        """Return δ² - E'X E, (k, k), or None without a disturbance."""
        if not self.is_disturbed:
            return None
        own = slice(self.R.rows, None)
        return -(self.W.block(own, own) + self.E.T @ (X @ self.E))

    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return bounds for |V⁻¹| |G'Z G| <= 1/2, with the price V = W + G'X G.

        The gains of X + Z are k + (V + G'Z G)⁻¹ G'Z F, and |(V + G'Z G)⁻¹| <= 2 |V⁻¹|.
        """
        G = _bound(self.G).norm()
        inverse = _bound(self.price(X)).inverse_norm()
        gains = 2 * inverse * G
        return Sensitivity(gains * G * _bound(loop).norm(), gains, inverse * G**2)

    def pencil(self) -> tuple[arb_mat, arb_mat]:
        """Return L and M, (2n + m + k, 2n + m + k), in `Balls`, whose pencil L - z M is singular at
        the eigenvalues of the loop of both players and at their inverses.
        """
        A, G, Q, W, C = (_of(each) for each in (self.A, self.G, self.Q, self.W, self.C))
        n, s = self.n, G.ncols()
        one = identity(n)

        def zeros(rows: int, columns: int) -> arb_mat:
            return ball_matrix(np.zeros((rows, columns)))

        L = stacked([[A, zeros(n, n), G], [-Q, one, -C], [C.transpose(), zeros(s, n), W]])
        M = stacked(
            [
                [one, zeros(n, n), zeros(n, s)],
                [zeros(n, n), A.transpose(), zeros(n, s)],
                [zeros(s, n), -G.transpose(), zeros(s, s)],
            ]
        )
        return L, M


def _bound(matrix: Any) -> BoundMatrix:
    """Return a matrix of an equation in the arithmetic of the bounds."""
    return matrix


def _of(matrix: BallMatrix) -> arb_mat:
    """Return the matrix of FLINT of an equation in `Balls`."""
    assert isinstance(matrix, Balls)
    return matrix.matrix


def equation_of(
    game: Game,
    units: Units,
    arithmetic: type[Matrix],
    delta: float | None = None,
    entries: Entries | None = None,
) -> Equation[Matrix]:
    """Return the Riccati equation of a game.

    entries: of the game in the units, if they are known

    Raises ZeroDivisionError if R is singular in continuous time.
    """
    kind = StepEquation[Matrix] if game.is_discrete else ContinuousEquation[Matrix]
    return kind(game, units, arithmetic, delta, entries)
