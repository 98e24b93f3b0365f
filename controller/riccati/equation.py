"""The Riccati equation of a game with the game's exact entries, in balls.

All is in exact units of the states, inputs and disturbances, which are powers of two, and, where P
is ill-conditioned in any units, in states T z with an exact matrix T: P is nearly 1 there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import (
    Near,
    Pair,
    ball_matrix,
    norm,
    part,
    scaled,
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


class Entries(NamedTuple):
    """Matrices of a game in exact units, with the discount: √α A, √α B, √α E, and the weights, of
    which Q and R are symmetric; G, H, W and C of both players as in `Equation`.
    """

    A: Any
    B: Any
    E: Any
    Q: Any
    R: Any
    N: Any
    G: Any
    H: Any
    W: Any
    C: Any

    @classmethod
    def of(cls, game: Game, units: Units, delta: float) -> Entries:
        """Return the matrices in exact units, and in the states T y: pairs of doubles if these are
        exact, else balls.

        y are the states in units of powers of two: the user's states are z_i = 2^states_i y_i, and
        likewise inputs and disturbances. Rows of rates are therefore scaled by 2^-states, columns
        and costs by 2^states.

        delta: in place of that of the game

        Raises ZeroDivisionError if T may be singular with the bits of `precision`.
        """
        from flint import arb

        matrices: Any = game.A, game.B, game.E, game.Q, game.R, game.N
        states, inputs, disturbances, T = units
        if isinstance(game, LoopGame):
            matrices = game.balls or matrices
        A, B, E, Q, R, N = matrices
        A, B = scaled(A, -states, states), scaled(B, -states, inputs)
        E, N = scaled(E, -states, disturbances), scaled(N, states, inputs)
        Q, R = scaled(Q, states, states), scaled(R, inputs, inputs)
        if not np.array_equal(game.weights, game.weights.T):
            Q, R = symmetric_part(ball_matrix(Q)), symmetric_part(ball_matrix(R))
        if T is not None:
            to_y = T.inv()
            A, B, E, Q, N = map(ball_matrix, (A, B, E, Q, N))
            Q = symmetric_part(to_y.transpose() * Q * to_y)
            A, B, E, N = T * A * to_y, T * B, T * E, to_y.transpose() * N
        if game.discount != 1.0:
            root = arb(game.discount).sqrt()
            A, B, E = (ball_matrix(matrix) * root for matrix in (A, B, E))
        matrices = A, B, E, Q, R, N
        are_doubles = all(isinstance(matrix, np.ndarray) for matrix in matrices)
        kind: Callable[[Any], Any] = Pair.of if are_doubles else ball_matrix
        A, B, E, Q, R, N = map(kind, matrices)
        if not (math.isfinite(delta) and game.E.any()):
            return cls(A, B, E, Q, R, N, B, stacked([[A, B]]), R, N)
        # -δ² I in the units of the disturbances. With those of `disturbance_units`, in which δ is
        # nearly 1, δ² is the exact sum of two doubles; in others, the second one may underflow.
        squares = [arb(entry) ** 2 for entry in np.ldexp(delta, disturbances)]
        high = [float(square) for square in squares]
        low = [float(square - double) for square, double in zip(squares, high, strict=True)]
        of_disturbance = kind(Pair(-np.diag(high), -np.diag(low)))
        none, coupling = kind(np.zeros(game.E.shape)), kind(np.zeros((len(game.R), len(high))))
        W = stacked([[R, coupling], [coupling.transpose(), of_disturbance]])
        G, H, C = (stacked([row]) for row in ([B, E], [A, B, E], [N, none]))
        return cls(A, B, E, Q, R, N, G, H, W, C)


@dataclass(frozen=True, eq=False, repr=False)
class LoopGame(Game):
    """Game whose exact matrices are in balls. Its fields A, B, ... are rounded to doubles.

    balls: the exact A, B, E, Q, R and N, from which `Entries.of` makes the Riccati equation
    """

    balls: tuple[arb_mat, ...] | None = None


class Sensitivity(NamedTuple):
    """Bounds of changes where X is changed by a symmetric Z, (n, n), with weight |Z| <= 1/2.

    loop: |change of the loop F of both players| <= loop |Z|
    gains: if |Z| <= Y and, in discrete time, F'Y F <= Y, |change of column j of the gains| is at
        most gains |s| s_j, with the roots s of the diagonal of Y
    weight: relative change of the weight of the players <= weight |Z|; 0 in continuous time
    """

    loop: arb
    gains: arb
    weight: arb


class Equation:
    """Riccati equation of a game in exact units, with the inputs of both players: G = [B E],
    W = blkdiag(R, -δ² I), C = [N 0] and H = [A G]. Without a disturbance, E has no columns there.

      A'X + X A + Q - (X G + C) W⁻¹ (G'X + C') = 0,
      A'X A - X + Q - (A'X G + C) (W + G'X G)⁻¹ (G'X A + C') = 0 in discrete time.

    The gains of X are k = W⁻¹ (G'X + C'), in discrete time (W + G'X G)⁻¹ (G'X A + C'), and the loop
    of both players is F = A - G k. K is the first rows of k, and -L the others.

    game: the game
    units: exact units
    delta: in place of that of the game
    kind: makes the matrices of the equation of exact doubles or balls: balls, `Near` or `Pair`

    The matrices are computed when they are first used, and then raise ZeroDivisionError if T may be
    singular.
    """

    def __init__(
        self,
        game: Game,
        units: Units,
        delta: float,
        kind: Callable[[Any], Any] = ball_matrix,
        exact: Entries | None = None,
    ) -> None:
        self.game, self.units, self.delta, self.kind = game, units, delta, kind
        self.n, self.is_discrete = len(game.A), game.is_discrete
        self.is_disturbed = math.isfinite(delta) and bool(game.E.any())
        if exact is not None:
            self.exact = exact

    @cached_property
    def exact(self) -> Entries:
        """The exact matrices, of which each kind is made."""
        return Entries.of(self.game, self.units, self.delta)

    def __getattr__(self, name: str) -> Any:
        """Return a matrix of `exact` of the kind of the equation."""
        if name not in Entries._fields:
            raise AttributeError(name)
        vars(self)[name] = self.kind(getattr(self.exact, name))
        return vars(self)[name]

    @cached_property
    def in_doubles(self) -> Equation:
        """The same equation with `Near` matrices."""
        return Equation(self.game, self.units, self.delta, Near.of, self.exact)

    @cached_property
    def in_pairs(self) -> Equation:
        """The same equation with `Pair` matrices."""
        return Equation(self.game, self.units, self.delta, Pair.of, self.exact)

    def weight(self, X: Any) -> Any:
        """Return the weight V of the players, W, in discrete time W + G'X G, (m + k, m + k)."""
        return self.W + self.G.transpose() * (X * self.G) if self.is_discrete else self.W

    @cached_property
    def inverse_W(self) -> Any:
        """W⁻¹, (m + k, m + k)."""
        return self.W.inv()

    def inverse_weight(self, X: Any) -> Any:
        """Return V⁻¹ of the weight of the players, (m + k, m + k)."""
        return self.weight(X).inv() if self.is_discrete else self.inverse_W

    def weights(self, X: Any) -> tuple[Any, Any]:
        """Return the weights of the inputs and of the disturbances, which must be positive: R and
        δ², in discrete time R + B'X B, (m, m), and δ² - E'X E, (k, k), of which the second is None
        without a disturbance.
        """
        weight, m = self.weight(X), len(self.game.R)
        if not self.is_disturbed:
            return weight, None
        inputs, disturbances = slice(m), slice(m, None)
        return part(weight, inputs, inputs), -part(weight, disturbances, disturbances)

    def gains_and_residual(self, X: Any) -> tuple[Any, Any]:
        """Return the gains k of X, (m + k, n), and the residual, (n, n), the left side at X.

        X: (n, n), symmetric, of the kind of the equation; for a `Pair`, the residual is `Near`

        Raises ZeroDivisionError if the weight of the players may be singular.
        """
        of_states, coupling, weight = self.forms(X)
        # With the weight V, M V⁻¹ M' of the coupling M is M k + k'error + error'V⁻¹ error for any
        # k, with error = M' - V k. What cancels is computed in the kind of the equation; what is as
        # small as the error of k, with V⁻¹, in doubles if that kind is `Pair`.
        rounded = Near.of if self.kind == Pair.of else self.kind
        inverse = rounded(weight).inv()
        k = self.kind((inverse * rounded(coupling).transpose()).mid())
        times_k = stacked([[coupling], [weight]]) * k
        error = rounded(coupling.transpose() - part(times_k, slice(self.n, None)))
        of_error = inverse * error
        rest = rounded(k).transpose() * error + error.transpose() * of_error
        residual = rounded(of_states - part(times_k, slice(self.n))) - rest
        return k + self.kind(of_error), symmetric_part(residual)

    def forms(self, X: Any) -> tuple[Any, Any, Any]:
        """Return A'X + X A + Q, X G + C and W, in discrete time A'X A - X + Q, A'X G + C and
        W + G'X G, of which the residual is the Schur complement.

        X: (n, n), symmetric
        """
        states, inputs = slice(self.n), slice(self.n, None)
        XH = X * self.H
        if not self.is_discrete:
            XA = part(XH, states, states)
            return XA + XA.transpose() + self.Q, part(XH, states, inputs) + self.C, self.W
        HXH = self.H.transpose() * XH
        of_states, coupling = part(HXH, states, states) - X, part(HXH, states, inputs)
        return of_states + self.Q, coupling + self.C, part(HXH, inputs, inputs) + self.W

    def changes(self, X: Any, loop: Any, Z: Any) -> tuple[Any, Any]:
        """Return the gains of X + Z minus those of X, and q(Z), (n, n), of the residual at X + Z.

        With the loop F at X, the residual is that at X plus F'Z + Z F + q(Z), in discrete time
        plus F'Z F - Z + q(Z). With V at X + Z and M = G'Z, in discrete time G'Z F, the gains change
        by V⁻¹ M, and q(Z) is -M'V⁻¹ M.

        loop: of both players at X

        Raises ZeroDivisionError as `gains_and_residual` does.
        """
        M = self.G.transpose() * (Z * loop if self.is_discrete else Z)
        of_gains = self.inverse_weight(X + Z) * M
        return of_gains, -(M.transpose() * of_gains)

    def loop(self, gains: Any) -> Any:
        """Return the loop of both players, A - G k, (n, n).

        gains: k
        """
        return self.A - self.G * gains

    def control_loop(self, gains: Any) -> Any:
        """Return the loop without disturbance, A - B K, (n, n).

        gains: k
        """
        return self.A - self.B * part(gains, slice(len(self.game.R)))

    def sensitivity(self, X: Any, loop: Any) -> Sensitivity:
        """Return bounds of the changes of the loop and the gains at X.

        In continuous time, the gains of X + Z are k + W⁻¹G'Z; in discrete time, with the weight V
        at X and |V⁻¹G'Z G| <= 1/2, they are k + (1 + V⁻¹G'Z G)⁻¹ V⁻¹G'Z F, and the first inverse is
        at most 2. The loop changes by G times the change of the gains.

        loop: of both players at X

        Raises ZeroDivisionError if the weight of the players may be singular.
        """
        G, of_Z = norm(self.G), norm(self.inverse_weight(X) * self.G.transpose())
        if not self.is_discrete:
            return Sensitivity(loop=of_Z * G, gains=of_Z, weight=of_Z * 0)
        # |F| counts for the loop only: for the gains, F'Y F <= Y bounds Z F as it bounds Z.
        return Sensitivity(loop=2 * of_Z * G * norm(loop), gains=2 * of_Z, weight=of_Z * G)

    def blocks(self) -> tuple[Any, Any, Any]:
        """Return A - G W⁻¹ C', S = G W⁻¹ G' and Q - C W⁻¹ C' of the Hamiltonian, which continuous
        time has.

        Raises ZeroDivisionError if W may be singular.
        """
        inverse, C_transposed = self.inverse_W, self.C.transpose()
        G_over_W = self.G * inverse
        S = G_over_W * self.G.transpose()
        return self.A - G_over_W * C_transposed, S, self.Q - self.C * inverse * C_transposed

    def half_plane_matrix(self) -> arb_mat:
        """Return the matrix of states and costates, with the bits of `precision`, without radii.

        Its eigenvalues with Re λ < 0 are those of the loop of both players, in discrete time
        (z - 1) / (z + 1) for each z of the loop. Its stable subspace is spanned by [1; X].

        It is the Hamiltonian [[A - G W⁻¹C', -S], [-(Q - C W⁻¹C'), -(A - G W⁻¹C')']], in discrete
        time a block of (L + M)⁻¹ (L - M) with the pencil L - z M: the columns beside it, of the
        inputs, have the eigenvalues 1 alone.

        Raises ZeroDivisionError if W may be singular or, in discrete time, z = -1 may be an
        eigenvalue.
        """
        if self.is_discrete:
            L, M = self.pencil()
            block = slice(2 * self.n)
            return part((L + M).mid().solve((L - M).mid()).mid(), block, block)
        A, S, Q = self.blocks()
        return stacked([[A, -S], [-Q, -A.transpose()]]).mid()

    def pencil(self) -> tuple[Any, Any]:
        """Return L and M, (2n + m + k, 2n + m + k), whose pencil L - z M is singular at the
        eigenvalues z of the loop of both players in discrete time, and at 1 / z.
        """
        A, G, C, one = self.A, self.G, self.C, self.kind(np.eye(self.n))
        none, no_gains = one * 0.0, G * 0.0
        L = [[A, none, G], [-self.Q, one, -C], [C.transpose(), no_gains.transpose(), self.W]]
        M = [
            [one, none, no_gains],
            [none, A.transpose(), no_gains],
            [no_gains.transpose(), -G.transpose(), self.W * 0.0],
        ]
        return stacked(L), stacked(M)
