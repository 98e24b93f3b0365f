"""Matrices of balls and Taylor models: the signs of eigenvalues, and the solution of a Riccati
equation, enclosed.

If H is symmetric and -(A'H + H A + 2 a H) is positive definite, A has as many eigenvalues with Re λ
< -a as H has positive ones, as many with Re λ > -a as H has negative ones, and none between:
Ostrowski and Schneider (J. Math. Anal. Appl. 4, 1962); with H > 0 it is Lyapunov's theorem. For a
fixed H the matrix is affine in A, and positive definite matrices form a convex cone: one H serves a
whole box when it serves the corners of the box."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.derivations import schur_solution
from hfa_support.errors import NoSolutionError
from verification.proof.arithmetic.balls import (
    TaylorModel,
    doubles,
    exact,
    is_positive_definite,
    matrix,
    norm,
    pivots,
    symmetric,
)

#: What a remainder is widened by.
_ROOM = 6
#: Newton's steps on balls, at most: near the solution the number of digits that are right doubles
#: with each.
_STEPS = 20
#: Relative size of a step after which the next one brings the last digits.
_SETTLED = 1e-18


class ProvedModes(NamedTuple):
    """How many eigenvalues of every matrix have Re λ > -a, with what proves it: H (n, n) in the
    coordinates turn."""

    unstable: int
    H: np.ndarray
    turn: np.ndarray


def counted(A: TaylorModel | arb_mat, rate: float = 0.0) -> ProvedModes | None:
    """Eigenvalues right of the line Re λ = -a, of every matrix; None when one may lie on it."""
    whole = TaylorModel.of(A)
    middle, *additions = whole.parts
    for H, turn in candidates(doubles(middle), rate, additions, additions[3:]):
        T, weight = matrix(turn), matrix(H)
        signs, half = (
            pivots(T.transpose() * weight * T),
            -(weight * (whole + matrix(rate * np.eye(len(H))))),
        )
        if signs is not None and is_positive(half + half.transpose(), turn):
            return ProvedModes(sum(1 for pivot in signs if pivot < 0), H, turn)
    return None


def unstable_modes(A: arb_mat) -> int | None:
    """Eigenvalues with a positive real part of every matrix in the balls; None when one may lie on
    the axis."""
    found = counted(A)
    return None if found is None else found.unstable


def candidates(
    A: np.ndarray, rate: float, *additions: Sequence[arb_mat]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """H (n, n) for a matrix and what may be added to it, found in doubles, and coordinates T in
    which to prove it.

    H = T⁻ᵀ diag(±h) T⁻¹ with the eigenvectors T of A, in which A is normal. For all of some
    additions h = y/x with G x = 1, G'y = 1, G = diag|Re λ + a| - N, N what they do at most in these
    coordinates: where G has a positive inverse, diag(h) G + G' diag(h) is positive definite (Berman
    and Plemmons 1979). h = 1/|Re λ + a|: Lyapunov's equation, for additions that do less than their
    entries could. None when the eigenvectors are dependent."""
    values, vectors = np.linalg.eig(A)
    distances, shares = np.abs(values.real + rate), []
    try:
        inverse = np.linalg.inv(vectors)
        for each in additions:
            G = np.diag(distances)
            for E in each:
                radii = np.array([[float(entry.rad()) for entry in row] for row in E.tolist()])
                G -= np.abs(inverse @ doubles(E) @ vectors) + np.abs(inverse) @ radii @ np.abs(
                    vectors
                )
            x, y = (np.linalg.solve(own, np.ones(len(A))) for own in (G, G.T))
            if min(x.min(), y.min()) > 0.0:
                shares.append(y / x)
    except np.linalg.LinAlgError:
        return
    with np.errstate(divide="ignore"):
        shares.insert(1, 1.0 / distances)
    # Real and imaginary parts: T = X U with a unitary U.
    parts = np.where(values.imag > 0.0, vectors.real, vectors.imag)
    congruence = np.where(values.imag == 0.0, vectors.real, np.sqrt(2.0) * parts)
    for h in shares:
        H = (
            inverse.conj().T @ ((np.where(values.real > -rate, -1.0, 1.0) * h)[:, None] * inverse)
        ).real
        if np.isfinite(H).all():
            yield (H + H.T) / 2, congruence


def is_positive(form: TaylorModel, turn: np.ndarray) -> bool:
    """Every symmetric matrix of the form is positive definite, with room: tested in the coordinates
    `turn`."""
    T = matrix(turn)
    turned = form.map(lambda part: T.transpose() * part * T)
    return all(map(is_positive_definite, roomy(turned).corners()))


def roomy(model: TaylorModel) -> TaylorModel:
    """The same with a remainder `_ROOM` times as large: a checker may enclose it less tightly."""
    c0, c1, c2, rest, *errors = model.parts
    return TaylorModel(c0, c1, c2, _ROOM * rest, *errors)


class BallGame(NamedTuple):
    """A'P + P A + Q - P S P = 0,  S = B R⁻¹ B' - δ⁻² E E', with A and B in balls and E, Q, R, δ
    exact doubles.

    game: the same in doubles, where the search begins. A, B: balls or Taylor models, in the units
    of the game."""

    game: Game
    A: Any
    B: Any

    @classmethod
    def of(cls, game: Game) -> BallGame:
        """The game whose matrices are the doubles, exactly."""
        return cls(game, matrix(game.A), matrix(game.B))

    def with_delta(self, delta: float) -> BallGame:
        """The same game at another disturbance weight."""
        return self._replace(game=self.game.with_delta(delta))

    def scaled(self, units: np.ndarray) -> BallGame:
        """The same game in the state y, z_i = u_i y_i; the units are powers of two, so that nothing
        is rounded."""
        up, down = matrix(np.diag(units)), matrix(np.diag(1.0 / units))
        return BallGame(in_units(self.game, units), down * self.A * up, down * self.B)

    def Q(self) -> arb_mat:
        """The symmetric part of the game's Q, on which alone the cost depends."""
        return _symmetric_part(matrix(self.game.Q))

    def gain(self) -> arb_mat:
        """R⁻¹ B'; K = R⁻¹ B' P."""
        return _symmetric_part(matrix(self.game.R)).inv() * self.B.transpose()

    def S(self) -> arb_mat:
        """B R⁻¹ B' - δ⁻² E E'."""
        E = matrix(self.game.E)
        return self.B * self.gain() - E * E.transpose() * (1 / exact(self.game.delta) ** 2)


def _symmetric_part(values: arb_mat) -> arb_mat:
    return (values + values.transpose()) * 0.5


class Enclosed(NamedTuple):
    """One and only one solution of the Riccati equation lies near P's midpoint, and it lies in P.

    P: balls, in the units of the game. units: balanced ones. stabilizing: A - S P is Hurwitz.
    stable: A - B K is. lowest: the sign of the lowest eigenvalue of P; 0 when open. Where P
    stabilizes, no other solution does: it is the value of the game, or the game has none."""

    P: arb_mat
    units: np.ndarray
    stabilizing: bool
    stable: bool
    lowest: int

    @property
    def is_value(self) -> bool:
        """The value of the game: stabilizing and positive definite."""
        return self.stabilizing and self.lowest > 0


def enclose_solution(ball_game: BallGame, start: np.ndarray | None = None) -> Enclosed:
    """The solution near `start`, (n, n), or near the one of the Schur method.

    With L(E) = A_c'E + E A_c, A_c = A - S P̂, the error E of P̂ solves E = -L⁻¹(F(P̂) - E S E). Let
    η bound |L⁻¹ F(P̂)|, β the norm of L⁻¹ and σ that of S. When 4 β σ η < 1 the map has one fixed
    point with |E| < 1/(2 β σ), and |E| <= 2 η (Kantorovich, for a quadratic equation; Banach's
    theorem). NoSolutionError when that cannot be shown."""
    units = balanced_units(ball_game.game)
    own, n = ball_game.scaled(units), len(units)
    first = schur_solution(own.game) if start is None else start * np.outer(units, units)
    if not np.isfinite(first).all():
        raise NoSolutionError("the Riccati equation has no finite solution to begin with")
    S, P = own.S(), matrix((first + first.T) / 2)
    for _ in range(_STEPS):
        correction, _ = _newton(own, S, P)
        P = _symmetric_part((P - correction).mid()).mid()
        if float(norm(correction.entries())) <= _SETTLED * float(norm(P.entries())):
            break
    correction, inverse_norm = _newton(own, S, P)
    eta, curvature = norm(correction.entries()), inverse_norm * norm(S.entries())
    if not 4 * curvature * eta < 1:
        raise NoSolutionError(
            "Kantorovich's condition is not met: the solution is not told from others"
        )
    # It is symmetric: both triangles enclose the same numbers.
    P = _symmetric_part(
        P - correction + arb_mat(n, n, [symmetric(curvature * (2 * eta) ** 2)] * n**2)
    )
    turn, back = matrix(np.linalg.eigh(doubles(P))[1]), matrix(np.diag(1.0 / units))
    found = pivots(turn.transpose() * P * turn)
    lowest = 0 if found is None else 1 if all(pivot > 0 for pivot in found) else -1
    stable = [unstable_modes(own.A - each * P) == 0 for each in (S, own.B * own.gain())]
    return Enclosed(back * P * back, units, stable[0], stable[1], lowest)


def _newton(game: BallGame, S: arb_mat, P: arb_mat) -> tuple[arb_mat, arb]:
    """L⁻¹ F(P) and a bound of the norm of L⁻¹ (Frobenius, as n² x n² matrix)."""
    n, residual = P.nrows(), game.A.transpose() * P + P * game.A + game.Q() - P * S * P
    try:
        inverse = lyapunov_operator(game.A - S * P).inv()
    except ZeroDivisionError as error:
        raise NoSolutionError(
            "the Riccati equation has a multiple root: A - S P is singular"
        ) from error
    return arb_mat(n, n, (inverse * arb_mat(n * n, 1, residual.entries())).entries()), norm(
        inverse.entries()
    )


def lyapunov_operator(loop: arb_mat) -> arb_mat:
    """L(E) = A_c'E + E A_c as a matrix, (n², n²), of E row by row: (L E)_ij = Σ A_c,ki E_kj + E_im
    A_c,mj."""
    places = [divmod(place, loop.nrows()) for place in range(loop.nrows() ** 2)]
    return arb_mat(
        [[loop[k, i] * (j == m) + loop[m, j] * (i == k) for k, m in places] for i, j in places]
    )
