"""The Riccati equation of a game with the game's exact entries, in balls of any arithmetic.

All is in exact units of the states, inputs and disturbances, which are powers of two, and, where P
is ill-conditioned in any units, in states T z with an exact matrix T: P is nearly 1 there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic, NamedTuple, TypeVar

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    Balls,
    DoubleBalls,
    Matrix,
    ball_matrix,
    identity,
    scaled_balls,
    stacked,
    symmetric_part,
)

if TYPE_CHECKING:
    from flint import arb, arb_mat

Other = TypeVar("Other", Balls, DoubleBalls)


class Units(NamedTuple):
    """Units of the states, inputs and disturbances as exponents of two: z_i = 2^states_i y_i.

    states: (n,) integers
    inputs: (m,) integers
    disturbances: (k,) integers
    T: (n, n), exact, if the states of the equation are T y; None for y
    """

    states: np.ndarray
    inputs: np.ndarray
    disturbances: np.ndarray
    T: arb_mat | None = None

    def value(self, X: arb_mat) -> arb_mat:
        """Return P of the states y, (n, n), for X of the states of the equation."""
        return X if self.T is None else self.T.transpose() * X * self.T

    def gain(self, rows: arb_mat) -> arb_mat:
        """Return gains of the states y, (m, n), for those of the states of the equation."""
        return rows if self.T is None else rows * self.T


def users_units(game: Game) -> Units:
    """Return the units in which the user gave a game: all exponents are 0."""
    n, m = game.B.shape
    sizes = (n, m, game.E.shape[1])
    states, inputs, disturbances = (np.zeros(size, dtype=int) for size in sizes)
    return Units(states, inputs, disturbances)


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


@dataclass(frozen=True, eq=False)
class Entries:
    """Matrices of a game in exact units, without discount, in balls where doubles overflow.

    Q and R are exactly symmetric.
    """

    A: np.ndarray | arb_mat
    B: np.ndarray | arb_mat
    E: np.ndarray | arb_mat
    Q: np.ndarray | arb_mat
    R: np.ndarray | arb_mat
    N: np.ndarray | arb_mat

    @classmethod
    def of(cls, game: Game, units: Units) -> Entries:
        """Return the matrices of a game in exact units."""
        states, inputs, disturbances, T = units
        exact = getattr(game, "balls", game)  # a `LoopGame` holds its entries as balls
        entries = cls(
            scaled(exact.A, -states, states),
            scaled(exact.B, -states, inputs),
            scaled(exact.E, -states, disturbances),
            _symmetric_weights(exact.Q, states),
            _symmetric_weights(exact.R, inputs),
            scaled(exact.N, states, inputs),
        )
        return entries if T is None else entries.in_states(T)

    def in_states(self, T: arb_mat) -> Entries:
        """Return the matrices in the states T z, in balls.

        T: (n, n), exact

        Raises ZeroDivisionError if T may be singular with the bits of `precision`.
        """
        A, B, E, Q, N = map(_balls, (self.A, self.B, self.E, self.Q, self.N))
        T_inverse = T.inv()
        transposed = T_inverse.transpose()
        return Entries(
            T * A * T_inverse,
            T * B,
            T * E,
            symmetric_part(transposed * Q * T_inverse),
            self.R,
            transposed * N,
        )

    @property
    def rounded(self) -> Entries:
        """The matrices in doubles."""
        exact = self.A, self.B, self.E, self.Q, self.R, self.N
        return Entries(*(Balls.of(matrix).midpoint for matrix in exact))

    @cached_property
    def R_inverse(self) -> arb_mat:
        """R⁻¹, (m, m), in the arithmetic of FLINT.

        Raises ZeroDivisionError if R is singular.
        """
        return _balls(self.R).inv()


class Sensitivity(NamedTuple):
    """Bounds of changes where X is changed by a symmetric Z, (n, n), with weight |Z| <= 1/2.

    The weight of the players is W + G'X G in discrete time (`StepEquation`).

    loop: |change of the loop F of both players| <= loop |Z|
    gains: if |Z| <= Y and F'Y F <= Y, in discrete time, |change of column j of the gains| is at
        most gains |s| s_j, with the roots s of the diagonal of Y
    weight: relative change of the weight <= weight |Z|; 0 in continuous time
    """

    loop: arb
    gains: arb
    weight: arb


class Equation(ABC, Generic[Matrix]):
    """Riccati equation of a game in exact units, whose matrices are balls of one arithmetic.

    game: the game
    units: exact units
    arithmetic: `Balls` or, for bounds, `DoubleBalls`
    delta: in place of that of the game
    entries: of the game in the units, if they are known

    A, B, E, Q, R, N: √α A, √α B, √α E with the discount α, and the weights, in the arithmetic
    w: 1 / delta², 0 without a disturbance
    """

    is_discrete: ClassVar[bool]
    arithmetic: type[Matrix]
    A: Matrix
    B: Matrix
    E: Matrix
    Q: Matrix
    R: Matrix
    N: Matrix

    def __init__(
        self,
        game: Game,
        units: Units,
        arithmetic: type[Matrix],
        delta: float | None = None,
        entries: Entries | None = None,
    ) -> None:
        from flint import arb

        self._in_arithmetics: dict[type[Any], Equation[Any]] = {arithmetic: self}
        self._last: tuple[Matrix, tuple[Matrix, Matrix]] | None = None
        self.game = game
        self.units = units
        self.arithmetic = arithmetic
        self.delta = game.delta if delta is None else delta
        self.entries = entries or Entries.of(game, units)
        exact = self.entries
        self.n = len(game.A)
        self.is_disturbed = math.isfinite(self.delta) and bool(game.E.any())
        self.w = 1 / arb(self.delta) ** 2 if self.is_disturbed else arb(0)
        self.A, self.B, self.E = map(self._discounted, (exact.A, exact.B, exact.E))
        self.Q, self.R, self.N = map(arithmetic.of, (exact.Q, exact.R, exact.N))

    def _discounted(self, matrix: np.ndarray | arb_mat) -> Matrix:
        """Return √α times a matrix, in the arithmetic."""
        from flint import arb

        exact = self.arithmetic.of(matrix)
        discount = self.game.discount
        return exact if discount == 1.0 else exact * arb(discount).sqrt()

    def with_arithmetic(self, arithmetic: type[Other]) -> Equation[Other]:
        """Return the same equation in another arithmetic, each made once."""
        if arithmetic not in self._in_arithmetics:
            other = equation_of(self.game, self.units, arithmetic, self.delta, self.entries)
            other._in_arithmetics = self._in_arithmetics | other._in_arithmetics
            self._in_arithmetics[arithmetic] = other
        return self._in_arithmetics[arithmetic]

    def gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return the gains of X, (m, n), in discrete time (m + k, n), and the residual, (n, n).

        The residual is the left side of the Riccati equation at X. Its digits cancel: doubles do
        not suffice. What is computed for the last X is kept.

        X: (n, n)

        Raises ZeroDivisionError if the weight of the inputs or of the disturbances may be singular.
        """
        if self._last is None or self._last[0] is not X:
            self._last = X, self._gains_and_residual(X)
        return self._last[1]

    @abstractmethod
    def _gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return what `gains_and_residual` returns, computed anew."""

    @abstractmethod
    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return the loop of both players, A - B K + E L, (n, n).

        gains: of X
        """

    @abstractmethod
    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return the loop without disturbance, A - B K, (n, n).

        gains: of X
        """

    @abstractmethod
    def input_weight(self, X: Matrix) -> Matrix:
        """Return R, in discrete time R + B'X B, (m, m), which must be positive definite."""

    @abstractmethod
    def disturbance_weight(self, X: Matrix) -> Matrix | None:
        """Return δ² - E'X E, (k, k), of discrete time, which must be positive definite.

        None in continuous time, where the weight is δ², and without a disturbance.
        """

    @abstractmethod
    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return bounds of the changes of the loop and the gains at X.

        loop: of both players at X
        """

    @abstractmethod
    def half_plane_matrix(self) -> arb_mat:
        """Return the matrix of states and costates, with the bits of `precision`, without radii.

        Its eigenvalues with Re λ < 0 are those of the loop of both players, in discrete time
        (z - 1) / (z + 1) for each z of the loop. Its stable subspace is spanned by [1; X]. The
        equation must be in `Balls`.

        Raises ZeroDivisionError in discrete time if z = -1 may be an eigenvalue.
        """


def _symmetric_weights(weights: np.ndarray | arb_mat, units: np.ndarray) -> np.ndarray | arb_mat:
    """Return the exact symmetric part of Q or R in exact units."""
    exact = scaled(weights, units, units)
    if isinstance(weights, np.ndarray) and np.array_equal(weights, weights.T):
        return exact
    return symmetric_part(_balls(exact))


def _balls(matrix: np.ndarray | arb_mat) -> arb_mat:
    """Return an exact matrix in the arithmetic of FLINT."""
    return ball_matrix(matrix) if isinstance(matrix, np.ndarray) else matrix


class ContinuousEquation(Equation[Matrix]):
    """Riccati equation A'X + X A + Q - (X B + N) R⁻¹ (B'X + N') + w X E E'X = 0.

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
        return self.E @ self.E.T * self.w

    @cached_property
    def S(self) -> Matrix:
        """B R⁻¹ B' - w E E', (n, n)."""
        return self.of_control - self.of_disturbance if self.is_disturbed else self.of_control

    @cached_property
    def open_loop(self) -> Matrix:
        """A - B R⁻¹ N', (n, n)."""
        return self.A - self._B_over_R @ self.N.T if self.game.N.any() else self.A

    @cached_property
    def cost(self) -> Matrix:
        """Q - N R⁻¹ N', (n, n)."""
        return self.Q - self.N @ self.R_inverse @ self.N.T if self.game.N.any() else self.Q

    @cached_property
    def _B_over_R(self) -> Matrix:
        """B R⁻¹, (n, m)."""
        return self.B @ self.R_inverse

    def _gains_and_residual(self, X: Matrix) -> tuple[Matrix, Matrix]:
        """Return the gain (m, n) and the residual (n, n) of X."""
        right = self.B.T @ X
        if self.game.N.any():
            right = right + self.N.T
        gain = self.R_inverse @ right
        XA = X @ self.A
        residual = XA + XA.T + self.Q - right.T @ gain
        if self.is_disturbed:
            EX = self.E.T @ X
            residual = residual + EX.T @ EX * self.w
        return gain, residual

    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B R⁻¹ N' - S X."""
        return self.open_loop - self.S @ X

    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B R⁻¹ N' - B R⁻¹ B'X."""
        return self.open_loop - self.of_control @ X

    def input_weight(self, X: Matrix) -> Matrix:
        """Return R."""
        return self.R

    def disturbance_weight(self, X: Matrix) -> None:
        """Return None: in continuous time, d costs δ²."""

    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return |S|, |R⁻¹ B'| and 0: the equation is quadratic."""
        from flint import arb

        return Sensitivity(self.S.norm(), self._B_over_R.norm(), arb(0))

    def hamiltonian(self: ContinuousEquation[Balls]) -> arb_mat:
        """Return [[A - B R⁻¹N', -S], [-(Q - N R⁻¹N'), -(A - B R⁻¹N')']], (2n, 2n), in `Balls`."""
        open_loop, S, cost = self.open_loop.matrix, self.S.matrix, self.cost.matrix
        return stacked([[open_loop, -S], [-cost, -open_loop.transpose()]])

    def half_plane_matrix(self: ContinuousEquation[Balls]) -> arb_mat:
        """Return the Hamiltonian."""
        return self.hamiltonian().mid()


class StepEquation(Equation[Matrix]):
    """Riccati equation A'X A - X + Q - (A'X G + C) (W + G'X G)⁻¹ (G'X A + C') = 0 of discrete time.

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
        weight = self.arithmetic.of(np.ldexp(np.eye(k), np.add.outer(d, d))) * (-1 / self.w)
        zeros = self.arithmetic.of(np.zeros((m, k)))
        upper, lower = self.R.beside(zeros), zeros.T.beside(weight)
        return upper.T.beside(lower.T).T

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
        weight: Any = self.weight(X)
        gains = weight.solve(right)
        # With the weight V, right'V⁻¹ right = k'right + error'V⁻¹ right for any k, with
        # error = right - V k: what is unknown of V⁻¹ right counts only with the error.
        k = gains.mid()
        error = right - weight @ k
        return gains, self.A.T @ ahead - X + self.Q - k.T @ right - error.T @ gains

    def weight(self, X: Matrix) -> Matrix:
        """Return the weight of the players in one step, W + G'X G, (m + k, m + k)."""
        return self.W + self.G.T @ (X @ self.G)

    def loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - G k."""
        return self.A - self.G @ gains

    def control_loop(self, X: Matrix, gains: Matrix) -> Matrix:
        """Return A - B K."""
        return self.A - self.B @ gains.block(slice(self.R.rows), slice(None))

    def input_weight(self, X: Matrix) -> Matrix:
        """Return R + B'X B, (m, m)."""
        return self.R + self.B.T @ (X @ self.B)

    def disturbance_weight(self, X: Matrix) -> Matrix | None:
        """Return δ² - E'X E, (k, k), or None without a disturbance."""
        if not self.is_disturbed:
            return None
        of_disturbance = slice(self.R.rows, None)
        return -(self.W.block(of_disturbance, of_disturbance) + self.E.T @ (X @ self.E))

    def sensitivity(self, X: Matrix, loop: Matrix) -> Sensitivity:
        """Return bounds for |V⁻¹| |G'Z G| <= 1/2, with the weight V = W + G'X G.

        The gains of X + Z are k + (V + G'Z G)⁻¹ G'Z F, and |(V + G'Z G)⁻¹| <= 2 |V⁻¹|.
        """
        G = self.G.norm()
        inverse = self.weight(X).inverse_norm()
        gains = 2 * inverse * G
        return Sensitivity(gains * G * loop.norm(), gains, inverse * G**2)

    def pencil(self: StepEquation[Balls]) -> tuple[arb_mat, arb_mat]:
        """Return L and M, (2n + m + k, 2n + m + k), in `Balls`, whose pencil L - z M is singular at
        the eigenvalues z of the loop of both players and at their inverses.
        """
        A, G, Q, W, C = (each.matrix for each in (self.A, self.G, self.Q, self.W, self.C))
        L, M = map(stacked, pencil_blocks(A, G, Q, W, C, identity(self.n)))
        return L, M

    def half_plane_matrix(self: StepEquation[Balls]) -> arb_mat:
        """Return (L + M)⁻¹ (L - M) of the pencil."""
        L, M = self.pencil()
        return (L + M).mid().solve((L - M).mid()).mid()


def pencil_blocks(A: Any, G: Any, Q: Any, W: Any, C: Any, one: Any, growth: Any = 1) -> Any:
    """Return the blocks of L and of M, whose pencil L - z M is singular at the eigenvalues z of the
    loop of both players in discrete time, and at 1 / (growth z).

    A, G, Q, W, C: of `StepEquation`, matrices of balls or of rationals of FLINT
    one: the identity, (n, n)
    growth: discount, if it is not in A and G
    """
    of_states, of_gains, of_inputs = 0 * A, 0 * G, 0 * W
    L = [[A, of_states, G], [-1 * Q, one, -1 * C], [C.transpose(), of_gains.transpose(), W]]
    M = [
        [one, of_states, of_gains],
        [of_states, A.transpose() * growth, of_gains],
        [of_gains.transpose(), G.transpose() * -growth, of_inputs],
    ]
    return L, M


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
