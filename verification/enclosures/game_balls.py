"""A zero-sum game whose matrices are balls, and its stabilizing solution enclosed by Kantorovich's theorem."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from flint import arb, arb_mat

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare_schur import schur_solution
from hfa_support.errors import NoSolutionError
from verification.arithmetic.balls import (
    doubles,
    exact,
    filled,
    map_entries,
    matrix,
    norm,
    pivots,
    symmetric,
    symmetric_part,
)
from verification.enclosures.eigenvalue_signs import counted

#: Newton's steps on balls, at most: near the solution the number of digits that are right doubles with each.
_STEPS = 20
#: Relative size of a step after which the next one brings the last digits.
_SETTLED = 1e-18


@dataclass(frozen=True, eq=False)
class BallGame:
    """A'P + P A + Q - P S P = 0,  S = B R⁻¹ B' - δ⁻² E E', with A and B in balls and E, Q, R, δ exact doubles.

    game: the same in doubles, where the search begins. A, B: balls, in the units of the game.
    """

    game: Game
    A: arb_mat
    B: arb_mat

    @classmethod
    def of(cls, game: Game) -> BallGame:
        """The game whose matrices are the doubles, exactly."""
        return cls(game, matrix(game.A), matrix(game.B))

    def with_delta(self, delta: float) -> BallGame:
        """The same game at another disturbance weight."""
        return replace(self, game=self.game.with_delta(delta))

    def scaled(self, units: np.ndarray) -> BallGame:
        """The same game in the state y, z_i = u_i y_i; the units are powers of two, so that nothing is rounded."""
        up, down = matrix(np.diag(units)), matrix(np.diag(1.0 / units))
        return BallGame(in_units(self.game, units), down * self.A * up, down * self.B)

    def Q(self) -> arb_mat:
        """The symmetric part of the game's Q, on which alone the cost depends."""
        return symmetric_part(matrix(self.game.Q))

    def R(self) -> arb_mat:
        """The symmetric part of the game's R."""
        return symmetric_part(matrix(self.game.R))

    def gain_of(self, P: arb_mat) -> arb_mat:
        """K = R⁻¹ B' P."""
        return self.R().inv() * self.B.transpose() * P

    def S(self) -> arb_mat:
        """B R⁻¹ B' - δ⁻² E E'."""
        control = self.B * self.R().inv() * self.B.transpose()
        if not np.isfinite(self.game.delta):
            return control
        E = matrix(self.game.E)
        return control - E * E.transpose() * (1 / exact(self.game.delta) ** 2)


@dataclass(frozen=True, eq=False)
class Enclosed:
    """One and only one solution of the Riccati equation lies near P's midpoint, and it lies in P.

    P: balls, in the units of the game. units: balanced ones. stabilizing: A - S P is Hurwitz. stable: A - B K is.
    signs: of the eigenvalues of P; None when open.
    """

    P: arb_mat
    units: np.ndarray
    stabilizing: bool
    stable: bool
    signs: tuple[int, ...] | None

    @property
    def is_value(self) -> bool:
        """The value of the game: stabilizing and positive definite."""
        return self.stabilizing and self.signs is not None and min(self.signs) > 0

    @property
    def is_indefinite(self) -> bool:
        """The stabilizing solution, of which there is at most one, has a negative eigenvalue: the game has no value."""
        return self.stabilizing and self.signs is not None and min(self.signs) < 0


def enclose_solution(ball_game: BallGame, start: np.ndarray | None = None) -> Enclosed:
    """The solution near `start`, (n, n), or near the one of the Schur method.

    With L(E) = A_c'E + E A_c, A_c = A - S P̂, the error E of P̂ solves E = -L⁻¹(F(P̂) - E S E). Let η bound
    |L⁻¹ F(P̂)|, β the norm of L⁻¹ and σ that of S. When 4 β σ η < 1 the map has one fixed point with
    |E| < 1/(2 β σ), and |E| <= 2 η (Kantorovich, for a quadratic equation; Banach's theorem).
    NoSolutionError when that cannot be shown.
    """
    units = balanced_units(ball_game.game)
    own = ball_game.scaled(units)
    first = schur_solution(own.game) if start is None else start * np.outer(units, units)
    if not np.isfinite(first).all():
        raise NoSolutionError("the Riccati equation has no finite solution to begin with")
    S, P = own.S(), matrix((first + first.T) / 2)
    for _ in range(_STEPS):
        correction, _ = _newton(own, S, P)
        P = map_entries(lambda entry: entry.mid(), P - correction)
        P = map_entries(lambda entry: entry.mid(), symmetric_part(P))
        if float(norm(correction.entries())) <= _SETTLED * float(norm(P.entries())):
            break
    correction, inverse_norm = _newton(own, S, P)
    eta, curvature = norm(correction.entries()), inverse_norm * norm(S.entries())
    if not 4 * curvature * eta < 1:
        raise NoSolutionError("Kantorovich's condition is not met: the solution is not told from others")
    radius = 2 * eta
    size = len(units)
    solution = P - correction + filled(size, size, symmetric(curvature * radius**2))
    solution = symmetric_part(solution)  # the solution is symmetric: both triangles enclose the same numbers
    found = pivots(_graded(solution))
    back = matrix(np.diag(1.0 / units))
    return Enclosed(
        back * solution * back,
        units,
        is_hurwitz(own.A - S * solution),
        is_hurwitz(own.A - own.B * own.gain_of(solution)),
        None if found is None else tuple(1 if pivot > 0 else -1 for pivot in found),
    )


def unstable_modes(A: arb_mat) -> int | None:
    """Eigenvalues with a positive real part of every matrix in the balls; None when one may lie on the axis."""
    found = counted(A)
    return None if found is None else found.unstable


def _newton(game: BallGame, S: arb_mat, P: arb_mat) -> tuple[arb_mat, arb]:
    """L⁻¹ F(P) and a bound of the norm of L⁻¹ (Frobenius, as n² x n² matrix)."""
    n = P.nrows()
    loop = game.A - S * P
    residual = game.A.transpose() * P + P * game.A + game.Q() - P * S * P
    try:
        inverse = lyapunov_operator(loop).inv()
    except ZeroDivisionError as error:
        raise NoSolutionError("the Riccati equation has a multiple root: A - S P is singular") from error
    flat = inverse * arb_mat([[entry] for entry in residual.entries()])
    return arb_mat(n, n, [row[0] for row in flat.tolist()]), norm(inverse.entries())


def lyapunov_operator(loop: arb_mat) -> arb_mat:
    """L(E) = A_c'E + E A_c as a matrix, (n², n²), of E row by row."""
    n = loop.nrows()
    rows = loop.tolist()
    entries = [[exact(0.0)] * (n * n) for _ in range(n * n)]
    for i in range(n):
        for j in range(n):
            for k in range(n):  # (A_c'E + E A_c)_ij = Σ_k A_c,ki E_kj + E_ik A_c,kj
                entries[n * i + j][n * k + j] += rows[k][i]
                entries[n * i + j][n * i + k] += rows[k][j]
    return arb_mat(entries)


def _graded(values: arb_mat) -> arb_mat:
    """The same signs of eigenvalues, in the eigenvectors of the midpoint."""
    turn = matrix(np.linalg.eigh(doubles(values))[1])
    return turn.transpose() * values * turn


def is_hurwitz(A: arb_mat) -> bool:
    """Every matrix in the balls is proved to have its eigenvalues in the open left half plane."""
    return unstable_modes(A) == 0
