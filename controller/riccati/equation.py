"""The Riccati equation of a game with the game's exact entries, in balls.

All is in exact units of the states, inputs and disturbances, which are powers of two, and, where P
is ill-conditioned in any units, in states T z with an exact matrix T: P is nearly 1 there.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    Near,
    ball_matrix,
    identity,
    norm,
    part,
    scaled_balls,
    scaled_doubles,
    stacked,
    symmetric_part,
)
from hfa_support.cached import cached_property

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

    def value(self, X: arb_mat) -> arb_mat:
        """Return P of the states y, (n, n), for X of the states of the equation."""
        return X if self.T is None else symmetric_part(self.T.transpose() * X * self.T)

    def gain(self, rows: arb_mat) -> arb_mat:
        """Return a gain for the states y, (m, n), from one for the states of the equation."""
        return rows if self.T is None else rows * self.T


def users_units(game: Game) -> Units:
    """Return the units in which the user gave a game: all exponents are 0."""
    sizes = (*game.B.shape, game.E.shape[1])
    states, inputs, disturbances = (np.zeros(size, dtype=int) for size in sizes)
    return Units(states, inputs, disturbances)


class Entries(NamedTuple):
    """Matrices of a game in exact units, without discount, in balls or `Near`. Q and R are
    symmetric.
    """

    A: Any
    B: Any
    E: Any
    Q: Any
    R: Any
    N: Any

    @classmethod
    def of(cls, game: Game, units: Units, *, is_near: bool = False) -> Entries:
        """Return the matrices of a game in exact units, and in the states T y.

        y are the states in units of powers of two: the user's states are z_i = 2^states_i y_i, and
        likewise inputs and disturbances. Rows of rates are therefore scaled by 2^-states, columns
        and costs by 2^states.

        is_near: whether they are `Near`: without T, doubles that are exact but for what underflows

        Raises ZeroDivisionError if T may be singular with the bits of `precision`.
        """
        matrices: Any = game.A, game.B, game.E, game.Q, game.R, game.N
        states, inputs, disturbances, T = units
        scaled: Callable[..., Any] = scaled_balls
        if isinstance(game, LoopGame):
            matrices = game.balls or matrices
        elif is_near and T is None:
            scaled = scaled_doubles
        A, B, E, Q, R, N = matrices
        A, B = scaled(A, -states, states), scaled(B, -states, inputs)
        E, N = scaled(E, -states, disturbances), scaled(N, states, inputs)
        Q, R = scaled(Q, states, states), scaled(R, inputs, inputs)
        if not np.array_equal(game.weights, game.weights.T):
            Q, R = symmetric_part(Q), symmetric_part(R)
        if T is not None:
            to_y = T.inv()
            Q = symmetric_part(to_y.transpose() * Q * to_y)
            A, B, E, N = T * A * to_y, T * B, T * E, to_y.transpose() * N
        entries = cls(A, B, E, Q, R, N)
        return cls(*map(Near.of, entries)) if is_near else entries


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
    """Riccati equation of a game in exact units.

    game: the game
    units: exact units
    delta: in place of that of the game
    is_near: whether the matrices are `Near` ones, with arguments of either kind; else balls

    A, B, E, Q, R, N: √α A, √α B, √α E with the discount α, and the weights
    w: 1 / delta², 0 without a disturbance

    All are computed when they are first used, and then raise ZeroDivisionError if T or, in
    continuous time, R may be singular.
    """

    is_discrete: ClassVar[bool]

    def __init__(self, game: Game, units: Units, delta: float, *, is_near: bool = False) -> None:
        from flint import arb

        self.game, self.units, self.delta, self.is_near = game, units, delta, is_near
        self.n = len(game.A)
        self.is_disturbed = math.isfinite(delta) and bool(game.E.any())
        self.w = 1 / arb(delta) ** 2 if self.is_disturbed else arb(0)

    @cached_property
    def entries(self) -> Entries:
        """The matrices, with the discount."""
        from flint import arb

        entries = Entries.of(self.game, self.units, is_near=self.is_near)
        if self.game.discount == 1.0:
            return entries
        root = arb(self.game.discount).sqrt()
        A, B, E, *weights = entries
        return Entries(A * root, B * root, E * root, *weights)

    def __getattr__(self, name: str) -> Any:
        """Return a matrix of the entries."""
        if name in Entries._fields:
            return getattr(self.entries, name)
        raise AttributeError(name)

    @cached_property
    def in_doubles(self) -> Self:
        """The same equation with `Near` matrices."""
        return type(self)(self.game, self.units, self.delta, is_near=True)

    def of_kind(self, matrix: np.ndarray | arb_mat) -> Any:
        """Return a matrix as one of the kind of this equation."""
        if self.is_near:
            return Near(matrix) if isinstance(matrix, np.ndarray) else Near.of(matrix)
        return ball_matrix(matrix) if isinstance(matrix, np.ndarray) else matrix

    @abstractmethod
    def gains_and_residual(self, X: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return the gains of X, (m, n), in discrete time (m + k, n), and the residual, (n, n).

        The residual is the left side of the Riccati equation at X.

        X: (n, n)

        Raises ZeroDivisionError if the weight of the inputs or of the disturbances may be singular.
        """

    @abstractmethod
    def changes(self, X: Any, loop: Any, Z: Any) -> tuple[Any, Any]:
        """Return the gains of X + Z minus those of X, and q(Z), (n, n), of the residual at X + Z.

        With the loop F at X, the residual is that at X plus F'Z + Z F + q(Z), in discrete time
        plus F'Z F - Z + q(Z).

        loop: of both players at X

        Raises ZeroDivisionError as `gains_and_residual` does.
        """

    @abstractmethod
    def loop(self, X: Any, gains: Any) -> Any:
        """Return the loop of both players, A - B K + E L, (n, n).

        gains: of X
        """

    def control_loop(self, gains: Any) -> Any:
        """Return the loop without disturbance, A - B K, (n, n)."""
        return self.A - self.B * part(gains, slice(self.R.nrows()))

    @abstractmethod
    def weights(self, X: Any) -> tuple[Any, Any]:
        """Return the weights of the inputs and of the disturbances, which must be positive.

        They are R, (m, m), and None for δ², in discrete time R + B'X B and δ² - E'X E, (k, k).
        Without a disturbance, the second is None.
        """

    @abstractmethod
    def sensitivity(self, X: Any, loop: Any) -> Sensitivity:
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
    """

    is_discrete = False

    @cached_property
    def R_inverse(self) -> Any:
        """R⁻¹, (m, m)."""
        return self.R.inv()

    def gains_and_residual(self, X: Any) -> tuple[Any, Any]:
        """Return the gain (m, n) and the residual (n, n) of X."""
        right = self.B.transpose() * X + self.N.transpose()
        gain = self.R_inverse * right
        XA = X * self.A
        residual = XA + XA.transpose() + self.Q - right.transpose() * gain
        if self.is_disturbed:
            XE = X * self.E
            residual = residual + XE * XE.transpose() * self.w
        return gain, residual

    def changes(self, X: Any, loop: Any, Z: Any) -> tuple[Any, Any]:
        """Return R⁻¹ B'Z and -Z S Z."""
        BZ = self.B.transpose() * Z
        of_gains = self.R_inverse * BZ
        quadratic = -(BZ.transpose() * of_gains)
        if self.is_disturbed:
            EZ = self.E.transpose() * Z
            quadratic = quadratic + EZ.transpose() * EZ * self.w
        return of_gains, quadratic

    def loop(self, X: Any, gains: Any) -> Any:
        """Return A - B K + w E E'X."""
        loop = self.control_loop(gains)
        return loop + self.E * (self.E.transpose() * X) * self.w if self.is_disturbed else loop

    def weights(self, X: Any) -> tuple[Any, None]:
        """Return R and None: d costs δ²."""
        return self.R, None

    def sensitivity(self, X: Any, loop: Any) -> Sensitivity:
        """Return bounds of |S|, |R⁻¹ B'| and 0: loop and gains are linear in X; the weight is R."""
        from flint import arb

        of_control = norm(self.R_inverse * self.B.transpose())
        of_S = of_control * norm(self.B) + self.w * norm(self.E) ** 2
        return Sensitivity(of_S, of_control, arb(0))

    def blocks(self) -> tuple[Any, Any, Any]:
        """Return A - B R⁻¹ N', S and Q - N R⁻¹ N', of which the Hamiltonian consists."""
        B_over_R, N_transposed = self.B * self.R_inverse, self.N.transpose()
        S = B_over_R * self.B.transpose()
        if self.is_disturbed:
            S = S - self.E * self.E.transpose() * self.w
        return self.A - B_over_R * N_transposed, S, self.Q - self.N * self.R_inverse * N_transposed

    def hamiltonian(self) -> arb_mat:
        """Return [[A - B R⁻¹N', -S], [-(Q - N R⁻¹N'), -(A - B R⁻¹N')']], (2n, 2n)."""
        A, S, Q = self.blocks()
        return stacked([[A, -S], [-Q, -A.transpose()]])

    def half_plane_matrix(self) -> arb_mat:
        """Return the Hamiltonian."""
        return self.hamiltonian().mid()


class StepEquation(Equation):
    """Riccati equation A'X A - X + Q - (A'X G + C) (W + G'X G)⁻¹ (G'X A + C') = 0 of discrete time.

    G = [B E], W = blkdiag(R, -δ² I) and C = [N 0]. Without a disturbance, E has no columns.

    The gains of X are k = (W + G'X G)⁻¹ (G'X A + C'), and the loop of both players is A - G k.
    """

    is_discrete = True

    @cached_property
    def G(self) -> Any:
        """[B E], (n, m + k)."""
        return stacked([[self.B, self.E]]) if self.is_disturbed else self.B

    @cached_property
    def W(self) -> Any:
        """Weight of the players, (m + k, m + k)."""
        if not self.is_disturbed:
            return self.R
        m, d = self.R.nrows(), self.units.disturbances
        # -δ² I in the units of d
        of_disturbance = self.of_kind(scaled_balls(identity(len(d)), d, d) * (-1 / self.w))
        coupling = self.of_kind(np.zeros((m, len(d))))
        return stacked([[self.R, coupling], [coupling.transpose(), of_disturbance]])

    @cached_property
    def C(self) -> Any:
        """[N 0], (n, m + k)."""
        none = self.of_kind(np.zeros(self.game.E.shape))
        return stacked([[self.N, none]]) if self.is_disturbed else self.N

    def gains_and_residual(self, X: arb_mat) -> tuple[arb_mat, arb_mat]:
        """Return the gains (m + k, n) and the residual (n, n) of X."""
        ahead, weight = X * self.A, self.weight(X)
        right = self.G.transpose() * ahead + self.C.transpose()
        gains = weight.solve(right)
        # With the weight V, right'V⁻¹ right is the symmetric part of k'(right + error) plus
        # error'V⁻¹ error for any k, with error = right - V k: what is unknown of V⁻¹ right counts
        # only with the error.
        k = gains.mid()
        error = right - weight * k
        players = k.transpose() * (right + error) + error.transpose() * (gains - k)
        return gains, symmetric_part(self.A.transpose() * ahead - players) - X + self.Q

    def changes(self, X: Any, loop: Any, Z: Any) -> tuple[Any, Any]:
        """Return k = (W + G'(X + Z) G)⁻¹ G'Z F with the loop F at X, and -F'Z G k."""
        GZF = self.G.transpose() * (Z * loop)
        of_gains = self.weight(X + Z).inv() * GZF
        return of_gains, -(GZF.transpose() * of_gains)

    def weight(self, X: Any) -> Any:
        """Return the weight of the players in one step, W + G'X G, (m + k, m + k)."""
        return self.W + self.G.transpose() * (X * self.G)

    def loop(self, X: Any, gains: Any) -> Any:
        """Return A - G k."""
        return self.A - self.G * gains

    def weights(self, X: Any) -> tuple[Any, Any]:
        """Return R + B'X B, and δ² - E'X E or None without a disturbance: blocks of `weight`."""
        weight, m = self.weight(X), self.R.nrows()
        if not self.is_disturbed:
            return weight, None
        inputs, disturbances = slice(m), slice(m, None)
        return part(weight, inputs, inputs), -part(weight, disturbances, disturbances)

    def sensitivity(self, X: Any, loop: Any) -> Sensitivity:
        """Return the bounds, with the weight V = W + G'X G and |V⁻¹G'Z G| <= 1/2.

        The gains of X + Z are k + (1 + V⁻¹G'Z G)⁻¹ V⁻¹G'Z F, and the first inverse is at most 2.
        The loop changes by G times the change of the gains.
        """
        G, of_Z = norm(self.G), norm(self.weight(X).inv() * self.G.transpose())
        # |F| counts for the loop only: for the gains, F'Y F <= Y bounds Z F as it bounds Z.
        return Sensitivity(loop=2 * of_Z * G * norm(loop), gains=2 * of_Z, weight=of_Z * G)

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


def pencil_blocks(A: Any, G: Any, Q: Any, W: Any, C: Any, one: Any) -> Any:
    """Return the blocks of L and of M, whose pencil L - z M is singular at the eigenvalues z of the
    loop of both players in discrete time, and at 1 / z.

    A, G, Q, W, C: of `StepEquation`, matrices of balls or doubles
    one: the identity, (n, n)
    """
    of_states, of_gains, of_inputs = 0 * A, 0 * G, 0 * W
    L = [[A, of_states, G], [-1 * Q, one, -1 * C], [C.transpose(), of_gains.transpose(), W]]
    M = [
        [one, of_states, of_gains],
        [of_states, A.transpose(), of_gains],
        [of_gains.transpose(), G.transpose() * -1, of_inputs],
    ]
    return L, M


def equation_of(game: Game, units: Units, delta: float) -> Equation:
    """Return the Riccati equation of a game, with the arguments of `Equation`."""
    kind = StepEquation if game.is_discrete else ContinuousEquation
    return kind(game, units, delta)
