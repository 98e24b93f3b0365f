"""Solutions of games with hundreds of digits, by the matrix sign function of their pencils.

The arithmetic is FLINT's, and of this project only the matrices of a `Game` are used: no floating-point
solver, no change of units, no R⁻¹ N'. With the costates λ = P z, the optimal play of a game solves

  σ z = A z + B u + E d,  -σ λ = Q z + A'λ + N u,  0 = N'z + R u + B'λ,  0 = -δ² d + E'λ

and in discrete time the same equations of steps. Its stable solutions are the range of (I - W) / 2
with W = sign(T), where T is the matrix of these equations without u and d, in discrete time after the
map s = (z - 1) / (z + 1). Source: Roberts, Int. J. Control 32 (1980).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_mat, ctx

from hfa import Game

#: Bits of all numbers, and the accuracy that is asserted of P.
BITS = 700
ACCURATE = 2.0**-300
#: Newton's iteration needs 10 to 30 steps, and one more for each halving of the distance between the
#: eigenvalues and the boundary of stability: an eigenvalue within 1e-30 of it counts as on it.
STEPS = 130


@dataclass(frozen=True)
class Reference:
    """Reference solution of a game; P, K and L are empty if it does not exist.

    exists: whether the stabilizing P exists, is positive semidefinite and a saddle point
    P: (n, n)
    K, L: (m, n) and (k, n), of u = -K z and d = L z
    """

    exists: bool
    P: np.ndarray
    K: np.ndarray
    L: np.ndarray


NOTHING = Reference(False, *np.empty((3, 0, 0)))


@contextmanager
def _precision() -> Iterator[None]:
    before, ctx.prec = ctx.prec, BITS
    try:
        yield
    finally:
        ctx.prec = before


def reference_solution(game: Game) -> Reference:
    """Return the solution of a game, rounded to doubles."""
    with _precision():
        found = _solution(_Exact(game))
        return NOTHING if found is None else Reference(True, *map(_doubles, found))


class _Exact:
    """The matrices of a game, with the discount taken into √α A, √α B and √α E."""

    def __init__(self, game: Game) -> None:
        self.is_discrete = game.is_discrete
        root = arb(game.discount).sqrt() if game.is_discrete else arb(1)
        self.A, self.B, self.E = (_exact(each) * root for each in (game.A, game.B, game.E))
        self.Q, self.R, self.N = map(_exact, (game.Q, game.R, game.N))
        self.weight = 1 / arb(game.delta) ** 2 if math.isfinite(game.delta) else arb(0)
        self.n, self.m = game.B.shape


def _solution(game: _Exact) -> tuple[Any, Any, Any] | None:
    """Return P, K and L, or None if the game has no value."""
    n = game.n
    try:
        T = _of_steps(game) if game.is_discrete else _of_rates(game)
    except ZeroDivisionError:  # an eigenvalue -1, or policies that are not unique
        return None
    W = _sign(T)
    size = T.nrows()
    if W is None or abs(float(W.trace()) - (size - 2 * n)) > 0.5:
        return None
    # (W + I) [I; Y] = 0: the first n columns of Y' are P
    shifted = W + _one(size)
    left, right = _columns(shifted, n, size), -_columns(shifted, 0, n)
    try:
        Y = (left.transpose() * left).solve(left.transpose() * right).mid()
    except ZeroDivisionError:
        return None
    P = _rows(Y, 0, n)
    P = ((P + P.transpose()) / 2).mid()
    if _size(P) <= _size(W) * arb(2) ** (-BITS // 2):
        P = arb_mat(n, n)
    if game.is_discrete:
        return _played(game, P)
    K = game.R.solve(game.B.transpose() * P + game.N.transpose()).mid()
    L = (game.E.transpose() * P * game.weight).mid()
    loop = game.A - game.B * K + game.E * L
    terms = [loop.transpose() * P, P * loop, game.Q, -(game.N * K), -(game.N * K).transpose()]
    terms += [K.transpose() * game.R * K]
    if game.weight != 0:
        terms += [-(L.transpose() * L) / game.weight]
    return (P, K, L) if _are_balanced(terms, n) and _is_positive(P) else None


def _played(game: _Exact, P: Any) -> tuple[Any, Any, Any] | None:
    """Return P, K and L of a game in discrete time, or None if they are no saddle point."""
    n = game.n
    PA, PE, PB = (P * each for each in (game.A, game.E, game.B))
    at_most = game.E.transpose() * PE * game.weight
    if not _is_positive(_one(at_most.nrows()) - at_most, strictly=True):
        return None
    price = game.R + game.B.transpose() * PB
    across = game.B.transpose() * PE
    pays = _one(at_most.nrows()) - at_most
    both = _stacked(
        [[price, across * game.weight], [across.transpose(), at_most * 1 - _one(pays.nrows())]]
    )
    right = _stacked([[game.B.transpose() * PA + game.N.transpose()], [game.E.transpose() * PA]])
    if not _is_positive(price, strictly=True):
        return None
    gains = both.solve(right).mid()
    K = _rows(gains, 0, game.m)
    L = -_rows(gains, game.m, gains.nrows()) * game.weight
    loop = game.A - game.B * K + game.E * L
    terms = [loop.transpose() * P * loop, -P, game.Q, -(game.N * K), -(game.N * K).transpose()]
    terms += [K.transpose() * game.R * K]
    if game.weight != 0:
        terms += [-(L.transpose() * L) / game.weight]
    return (P, K, L.mid()) if _are_balanced(terms, n) and _is_positive(P) else None


def _of_rates(game: _Exact) -> Any:
    """Return the Hamiltonian matrix of a game in continuous time."""
    F = game.R.solve(game.N.transpose()).mid()
    A = game.A - game.B * F
    Q = game.Q - game.N * F
    S = game.B * game.R.solve(game.B.transpose()) - game.E * game.E.transpose() * game.weight
    return _stacked([[A, -S], [-Q, -A.transpose()]]).mid()


def _of_steps(game: _Exact) -> Any:
    """Return (L + M)⁻¹ (L - M) of the pencil L - z M of a game in discrete time, over (z, λ, u, d)."""
    n, m, k = game.n, game.m, game.E.ncols()
    one, zero = _one(n), arb_mat(n, n)
    # d is in units of δ², so that δ = inf is allowed
    E = game.E * game.weight
    left = _stacked(
        [
            [game.A, zero, game.B, E],
            [-game.Q, one, -game.N, arb_mat(n, k)],
            [game.N.transpose(), arb_mat(m, n), game.R, arb_mat(m, k)],
            [arb_mat(k, n), arb_mat(k, n), arb_mat(k, m), -_one(k)],
        ]
    )
    right = _stacked(
        [
            [one, zero, arb_mat(n, m + k)],
            [zero, game.A.transpose(), arb_mat(n, m + k)],
            [arb_mat(m, n), -game.B.transpose(), arb_mat(m, m + k)],
            [arb_mat(k, n), -game.E.transpose(), arb_mat(k, m + k)],
        ]
    )
    return (left + right).solve(left - right).mid()


def _sign(T: Any) -> Any:
    """Return sign(T) by Newton's iteration Z <- (c Z + Z⁻¹/c)/2, or None if an eigenvalue is on
    the boundary of stability.
    """
    Z = T
    for _ in range(STEPS):
        try:
            inverse = Z.inv().mid()
        except ZeroDivisionError:
            return None
        scale = (_size(inverse) / _size(Z)).sqrt().mid()
        if abs(float(scale) - 1.0) < 0.1:
            scale = arb(1)
        following = ((Z * scale + inverse / scale) / 2).mid()
        settled = _size(following - Z) < arb(2) ** (-BITS // 2) * _size(following)
        Z = following
        if settled:
            # If eigenvalues are on the boundary, Z may converge to the sign of rounding errors.
            apart = _size(Z * T - T * Z) / (_size(Z) * _size(T))
            return Z if apart < ACCURATE else None
    return None


def _is_positive(matrix: Any, *, strictly: bool = False) -> bool:
    """Return whether a symmetric matrix is positive definite, or by default semidefinite within a
    relative 1e-40.
    """
    size = matrix.nrows()
    rows = [[matrix[i, j].mid() for j in range(size)] for i in range(size)]
    if not strictly:
        for i in range(size):
            rows[i][i] = rows[i][i] * (1 + arb("1e-40").mid())
    for k in range(size):
        pivot = rows[k][k]
        if pivot < 0 or (pivot == 0 and (strictly or any(x != 0 for x in rows[k][k:]))):
            return False
        if pivot > 0:
            for i in range(k + 1, size):
                share = (rows[i][k] / pivot).mid()
                rows[i] = [(x - share * y).mid() for x, y in zip(rows[i], rows[k], strict=True)]
    return True


def _are_balanced(terms: list[Any], n: int) -> bool:
    """Return whether the terms (n, n) of a Riccati equation add up to 0, relative to the terms of
    the same states, or by 2^-300 relative to all.

    They do not if an eigenvalue is on the boundary of stability: the sign is one of rounding then.
    """
    total = sum(terms[1:], terms[0])
    diagonals = [max(abs(term[i, i]).mid() for term in terms) for i in range(n)]
    rounding = max(diagonals) * arb(2) ** -300
    for i in range(n):
        for j in range(n):
            size = (diagonals[i] * diagonals[j]).sqrt() * arb(2) ** -150 + rounding
            if not abs(total[i, j]).mid() <= size.mid():
                return False
    return True


def _exact(matrix: np.ndarray) -> Any:
    return arb_mat(*matrix.shape, [arb(x) for x in matrix.ravel().tolist()])


def _one(size: int) -> Any:
    return arb_mat(size, size, [arb(int(i == j)) for i in range(size) for j in range(size)])


def _stacked(blocks: list[list[Any]]) -> Any:
    rows = [
        [x for block in row for x in block.tolist()[i]]
        for row in blocks
        for i in range(row[0].nrows())
    ]
    return arb_mat(rows)


def _columns(matrix: Any, first: int, end: int) -> Any:
    return arb_mat([row[first:end] for row in matrix.tolist()])


def _rows(matrix: Any, first: int, end: int) -> Any:
    return arb_mat(matrix.tolist()[first:end])


def _size(matrix: Any) -> Any:
    return max(sum(abs(x) for x in row) for row in matrix.tolist()).mid()


def _doubles(matrix: Any) -> np.ndarray:
    return np.array([[float(x) for x in row] for row in matrix.tolist()])


def relative_error(value: np.ndarray, exact: np.ndarray) -> float:
    """Return ‖value - exact‖ / ‖exact‖ in the Frobenius norm."""
    return float(np.linalg.norm(value - exact) / np.linalg.norm(exact))
