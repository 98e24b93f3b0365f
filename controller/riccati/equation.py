"""The Riccati equation of a game with the game's exact entries, in balls.

All is in exact units of the states, inputs and disturbances, which are powers of two, and, where P
is ill-conditioned in any units, in states T z with an exact matrix T: P is nearly 1 there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    ball_matrix,
    identity,
    norm,
    part,
    scaled_balls,
    stacked,
    symmetric_part,
)

if TYPE_CHECKING:
    from flint import arb, arb_mat


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

    def value_of_user(self, X: arb_mat) -> arb_mat:
        """Return P of the user's states, (n, n), for X of the states of the equation."""
        of_y = X if self.T is None else symmetric_part(self.T.transpose() * X * self.T)
        return scaled_balls(of_y, -self.states, -self.states)

    def gain_of_user(self, rows: arb_mat, units: np.ndarray) -> arb_mat:
        """Return a gain for the user's states, (m, n), from one for the states of the equation.

        rows: the gain for the states of the equation
        units: of its rows, (m,) integers
        """
        of_y = rows if self.T is None else rows * self.T
        return scaled_balls(of_y, units, -self.states)


def users_units(game: Game) -> Units:
    """Return the units in which the user gave a game: all exponents are 0."""
    n, m = game.B.shape
    sizes = (n, m, game.E.shape[1])
    states, inputs, disturbances = (np.zeros(size, dtype=int) for size in sizes)
    return Units(states, inputs, disturbances)


class Entries(NamedTuple):
    """Matrices of a game in exact units, without discount. Q and R are symmetric."""

    A: arb_mat
    B: arb_mat
    E: arb_mat
    Q: arb_mat
    R: arb_mat
    N: arb_mat

    @classmethod
    def of(cls, game: Game, units: Units) -> Entries:
        """Return the matrices of a game in exact units, and in the states T y.

        y are the states in units of powers of two: the user's states are z_i = 2^states_i y_i, and
        likewise inputs and disturbances. Rows of rates are therefore scaled by 2^-states, columns
        and costs by 2^states.

        Raises ZeroDivisionError if T may be singular with the bits of `precision`.
        """
        doubles = (game.A, game.B, game.E, game.Q, game.R, game.N)
        of_loop_game = game.balls if isinstance(game, LoopGame) else None
        A, B, E, Q, R, N = of_loop_game or map(ball_matrix, doubles)
        states, inputs, disturbances, T = units
        A, B = scaled_balls(A, -states, states), scaled_balls(B, -states, inputs)
        E, N = scaled_balls(E, -states, disturbances), scaled_balls(N, states, inputs)
        Q = symmetric_part(scaled_balls(Q, states, states))
        R = symmetric_part(scaled_balls(R, inputs, inputs))
        if T is None:
            return cls(A, B, E, Q, R, N)
        to_y = T.inv()
        Q = symmetric_part(to_y.transpose() * Q * to_y)
        return cls(T * A * to_y, T * B, T * E, Q, R, to_y.transpose() * N)


@dataclass(frozen=True, eq=False, repr=False)
class LoopGame(Game):
    """Game whose exact matrices are in balls. Its fields A, B, ... are rounded to doubles.

    balls: the exact matrices, from which `Entries.of` makes the Riccati equation
    """

    balls: Entries | None = None


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


class Equation(ABC):
    """Riccati equation of a game in exact units, whose matrices are balls.

    game: the game
    units: exact units
    delta: in place of that of the game
    entries: of the game in the units, if they are known

    A, B, E, Q, R, N: √α A, √α B, √α E with the discount α, and the weights
    w: 1 / delta², 0 without a disturbance

    Raises ZeroDivisionError if R is singular in continuous time.
    """

    is_discrete: ClassVar[bool]

    def __init__(
        self, game: Game, units: Units, delta: float, entries: Entries | None = None
    ) -> None:
        from flint import arb

        self.game, self.units, self.delta = game, units, delta
        self.n = len(game.A)
        self.is_disturbed = math.isfinite(delta) and bool(game.E.any())
        self.w = 1 / arb(delta) ** 2 if self.is_disturbed else arb(0)
        A, B, E, self.Q, self.R, self.N = entries or Entries.of(game, units)
        root = arb(game.discount).sqrt()
        self.A, self.B, self.E = A * root, B * root, E * root

    @abstractmethod
    def gains_and_residual(self, X: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return the gains of X, (m, n), in discrete time (m + k, n), and the residual, (n, n).

        The residual is the left side of the Riccati equation at X.

        X: (n, n)

        Raises ZeroDivisionError if the weight of the inputs or of the disturbances may be singular.
        """

    @abstractmethod
    def loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return the loop of both players, A - B K + E L, (n, n).

        gains: of X
        """

    @abstractmethod
    def control_loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return the loop without disturbance, A - B K, (n, n).

        gains: of X
        """

    @abstractmethod
    def weights(self, X: arb_mat) -> tuple[arb_mat, arb_mat | None]:
        """Return the weights of the inputs and of the disturbances, which must be positive.

        They are R, (m, m), and None for δ², in discrete time R + B'X B and δ² - E'X E, (k, k).
        Without a disturbance, the second is None.
        """

    @abstractmethod
    def sensitivity(self, X: arb_mat, loop: arb_mat) -> Sensitivity:
        """Return bounds of the changes of the loop and the gains at X.

        loop: of both players at X

        Raises ZeroDivisionError if the weight of the players may be singular.
        """

    @abstractmethod
    def half_plane_matrix(self) -> arb_mat:
        """Return the matrix of states and costates, with the bits of `precision`, without radii.

        Its eigenvalues with Re λ < 0 are those of the loop of both players, in discrete time
        (z - 1) / (z + 1) for each z of the loop. Its stable subspace is spanned by [1; X].

        Raises ZeroDivisionError in discrete time if z = -1 may be an eigenvalue.
        """


class ContinuousEquation(Equation):
    """Riccati equation A'X + X A + Q - (X B + N) R⁻¹ (B'X + N') + w X E E'X = 0.

    The gain of X is R⁻¹ (B'X + N'), and the loop of both players is A - B R⁻¹ N' - S X with
    S = B R⁻¹ B' - w E E'.

    open_loop: A - B R⁻¹ N', (n, n)
    of_control: B R⁻¹ B', (n, n)
    """

    is_discrete = False

    def __init__(
        self, game: Game, units: Units, delta: float, entries: Entries | None = None
    ) -> None:
        super().__init__(game, units, delta, entries)
        self.R_inverse = self.R.inv()
        self.B_over_R = self.B * self.R_inverse
        self.open_loop = self.A - self.B_over_R * self.N.transpose()
        self.of_control = self.B_over_R * self.B.transpose()
        self.S = self.of_control - self.E * self.E.transpose() * self.w

    def gains_and_residual(self, X: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return the gain (m, n) and the residual (n, n) of X."""
        right = self.B.transpose() * X + self.N.transpose()
        gain = self.R_inverse * right
        XA, XE = X * self.A, X * self.E
        residual = XA + XA.transpose() + self.Q - right.transpose() * gain
        return gain, residual + XE * XE.transpose() * self.w

    def loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return A - B R⁻¹ N' - S X."""
        return self.open_loop - self.S * X

    def control_loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return A - B R⁻¹ N' - B R⁻¹ B'X."""
        return self.open_loop - self.of_control * X

    def weights(self, X: arb_mat) -> tuple[arb_mat, None]:
        """Return R and None: d costs δ²."""
        return self.R, None

    def sensitivity(self, X: arb_mat, loop: arb_mat) -> Sensitivity:
        """Return |S|, |R⁻¹ B'| and 0: loop and gains are linear in X, and the weight is R."""
        from flint import arb

        return Sensitivity(norm(self.S), norm(self.B_over_R), arb(0))

    def hamiltonian(self) -> arb_mat:
        """Return [[A - B R⁻¹N', -S], [-(Q - N R⁻¹N'), -(A - B R⁻¹N')']], (2n, 2n)."""
        cost = self.Q - self.N * self.R_inverse * self.N.transpose()
        return stacked([[self.open_loop, -self.S], [-cost, -self.open_loop.transpose()]])

    def half_plane_matrix(self) -> arb_mat:
        """Return the Hamiltonian."""
        return self.hamiltonian().mid()


class StepEquation(Equation):
    """Riccati equation A'X A - X + Q - (A'X G + C) (W + G'X G)⁻¹ (G'X A + C') = 0 of discrete time.

    G = [B E], W = blkdiag(R, -δ² I) and C = [N 0]. Without a disturbance, E has no columns.

    The gains of X are k = (W + G'X G)⁻¹ (G'X A + C'), and the loop of both players is A - G k.
    """

    is_discrete = True

    def __init__(
        self, game: Game, units: Units, delta: float, entries: Entries | None = None
    ) -> None:
        super().__init__(game, units, delta, entries)
        self.G, self.W, self.C = self.B, self.R, self.N
        if self.is_disturbed:
            d = units.disturbances
            # -δ² I in the units of d
            of_disturbance = scaled_balls(identity(len(d)), d, d) * (-1 / self.w)
            coupling = 0 * (self.B.transpose() * self.E)
            self.G = stacked([[self.B, self.E]])
            self.W = stacked([[self.R, coupling], [coupling.transpose(), of_disturbance]])
            self.C = stacked([[self.N, 0 * self.E]])

    def gains_and_residual(self, X: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return the gains (m + k, n) and the residual (n, n) of X."""
        ahead, weight = X * self.A, self.weight(X)
        right = self.G.transpose() * ahead + self.C.transpose()
        gains = weight.solve(right)
        # With the weight V, right'V⁻¹ right = k'right + error'V⁻¹ right for any k, with
        # error = right - V k: what is unknown of V⁻¹ right counts only with the error.
        k = gains.mid()
        error = right - weight * k
        players = k.transpose() * right + error.transpose() * gains
        return gains, self.A.transpose() * ahead - X + self.Q - players

    def weight(self, X: arb_mat) -> arb_mat:
        """Return the weight of the players in one step, W + G'X G, (m + k, m + k)."""
        return self.W + self.G.transpose() * (X * self.G)

    def loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return A - G k."""
        return self.A - self.G * gains

    def control_loop(self, X: arb_mat, gains: arb_mat) -> arb_mat:
        """Return A - B K."""
        return self.A - self.B * part(gains, slice(self.R.nrows()))

    def weights(self, X: arb_mat) -> tuple[arb_mat, arb_mat | None]:
        """Return R + B'X B, and δ² - E'X E or None without a disturbance: blocks of `weight`."""
        weight, m = self.weight(X), self.R.nrows()
        if not self.is_disturbed:
            return weight, None
        inputs, disturbances = slice(m), slice(m, None)
        return part(weight, inputs, inputs), -part(weight, disturbances, disturbances)

    def sensitivity(self, X: arb_mat, loop: arb_mat) -> Sensitivity:
        """Return the bounds, with the weight V = W + G'X G and |V⁻¹| |G'Z G| <= 1/2.

        The gains of X + Z are k + (V + G'Z G)⁻¹ G'Z F, and |(V + G'Z G)⁻¹| <= 2 |V⁻¹|. The loop
        changes by G times the change of the gains.
        """
        G, inverse = norm(self.G), norm(self.weight(X).inv())
        gains = 2 * inverse * G
        # |F| counts for the loop only: for the gains, F'Y F <= Y bounds Z F as it bounds Z.
        return Sensitivity(loop=gains * G * norm(loop), gains=gains, weight=inverse * G**2)

    def pencil(self) -> tuple[arb_mat, arb_mat]:
        """Return L and M, (2n + m + k, 2n + m + k), whose pencil L - z M is singular at the
        eigenvalues z of the loop of both players and at their inverses.
        """
        one = identity(self.n)
        L, M = map(stacked, pencil_blocks(self.A, self.G, self.Q, self.W, self.C, one))
        return L, M

    def half_plane_matrix(self) -> arb_mat:
        """Return (L + M)⁻¹ (L - M) of the pencil L - z M: λ = (z - 1) / (z + 1)."""
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


def equation_of(game: Game, units: Units, delta: float, entries: Entries | None = None) -> Equation:
    """Return the Riccati equation of a game, with the arguments of `Equation`."""
    kind = StepEquation if game.is_discrete else ContinuousEquation
    return kind(game, units, delta, entries)
