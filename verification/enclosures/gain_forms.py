"""The exact game's gain over a box of dihedrals, enclosed about a polynomial."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb_mat

from controller.game.zero_sum import Game, published_game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare import solve_game
from verification.arithmetic.ball_function import Undecided
from verification.arithmetic.balls import doubles, exact, filled, map_entries, matrix, norm, symmetric
from verification.enclosures.game_balls import lyapunov_operator
from verification.enclosures.inertia import counted
from verification.enclosures.trim_branch import ModelForms

Polynomial = list["arb_mat"]
#: How much wider than what Newton's step shows the solution is sought.
_REACH = 4.0
#: ... and how much wider a certificate states it, and the contraction that leaves the checker room: it takes a box of
#: entries where a ball is meant, which is n times as large in norm.
_STATED, _CONTRACTION = 36.0, 0.6


@dataclass(frozen=True, eq=False)
class GainForm:
    """K(τ) within rest, entry by entry, of K_0 + K_1 τ + K_2 τ²: coefficients (3, 5, 6), rest (5, 6), τ in degrees.

    proof: what a certificate says of P on the box. loose: how far from K, Frobenius, that leaves whoever checks it.
    """

    coefficients: np.ndarray
    rest: np.ndarray
    proof: dict[str, Any]
    loose: float


def gain_form(forms: ModelForms) -> GainForm:
    """The gain of the published game on a box. Undecided when the box is too wide.

    P̂(τ) solves the Riccati equation to second order in doubles. With L(E) = A_c'E + E A_c on all of the box and C
    about its inverse, E = -C F(P̂) + (I - C L) E + C (E S E) has one solution |E| < reach at every τ, and L stays
    invertible: no mode of A - S P crosses the axis.
    """
    A, B = ([*form.parts[:3], last] for form, last in zip((forms.A, forms.B), forms.cubic, strict=True))
    game = published_game(doubles(A[0]), doubles(B[0]))
    units = balanced_units(game)
    up, down = matrix(np.diag(units)), matrix(np.diag(1.0 / units))
    A, B = [down * each * up for each in A], [down * each for each in B]
    own, n = in_units(game, units), len(units)
    R_inverse, Q, E = matrix(own.R).inv(), matrix(own.Q), matrix(own.E)
    S = _product(B, [R_inverse * each.transpose() for each in B])
    S[0] = S[0] - E * E.transpose() * (1 / exact(own.delta) ** 2)
    guess = _solution(own, [doubles(each) for each in A[:3]], [doubles(each) for each in S[:3]])
    P = [matrix(each) for each in guess]
    half = _product([each.transpose() for each in A], P)
    residual = _sum(half, [each.transpose() for each in half], [-each for each in _product(P, _product(S, P))], [Q])
    loop = _sum(A, [-each for each in _product(S, P)])
    L = lyapunov_operator(_range(loop))
    C = matrix(np.linalg.inv(doubles(L)))
    step = C * arb_mat([[entry] for entry in _range(residual).entries()])
    slope, bend = (
        norm((matrix(np.eye(n * n)) - C * L).entries()),
        norm(C.entries()) * norm(_range(S).entries()),
    )
    reach = exact(_REACH * float(norm(step.entries()).upper()))
    rest = slope * reach + bend * reach**2
    modes = counted(loop[0])
    if (
        modes is None
        or modes.unstable
        or not (norm(step.entries()) + rest < reach and slope + 2 * n * bend * _STATED * reach < _CONTRACTION)
    ):
        raise Undecided("the solution of the game is not enclosed on this box")
    error = arb_mat(n, n, [symmetric(rest) - entry for entry in step.entries()])
    gains = [R_inverse * each * down for each in _product([each.transpose() for each in B], P)]
    over = _range([R_inverse * each.transpose() for each in B]) * error * down
    for k, each in enumerate(gains):
        over += map_entries(lambda entry, k=k: symmetric(entry if k > 2 else entry - entry.mid()), each)
    bounds = np.array([[float(abs(entry).upper()) for entry in row] for row in over.tolist()])
    proof = {
        "units": units,
        "P": guess,
        "reach": _STATED * float(reach),
        "H": modes.H,
        "turn": modes.turn,
    }
    loose = R_inverse * B[0].transpose() * filled(n, n, symmetric(proof["reach"])) * down
    scales = 1.0 / float(forms.box.radius) ** np.arange(3)[:, None, None]
    return GainForm(
        np.array([doubles(each) for each in gains[:3]]) * scales, bounds, proof, float(norm(loose.entries()).upper())
    )


def _solution(game: Game, A: list[np.ndarray], S: list[np.ndarray]) -> list[np.ndarray]:
    """P_0, P_1, P_2 of the Riccati equation along the box, in doubles: one Lyapunov equation an order."""
    from scipy.linalg import solve_continuous_lyapunov

    P = [solve_game(game).P]
    loop = A[0] - S[0] @ P[0]
    for order in (1, 2):
        known = [*P, np.zeros_like(P[0])]
        rest = sum(A[i].T @ known[order - i] + known[order - i] @ A[i] for i in range(order + 1))
        for i in range(order + 1):
            for j in range(order + 1 - i):
                rest = rest - known[i] @ S[j] @ known[order - i - j]
        found = solve_continuous_lyapunov(loop.T, -rest)
        P.append((found + found.T) / 2)
    return P


def _product(X: Polynomial, Y: Polynomial) -> Polynomial:
    """Of two polynomials in s with matrices of balls."""
    found: list[Any] = [None] * (len(X) + len(Y) - 1)
    for i, x in enumerate(X):
        for j, y in enumerate(Y):
            found[i + j] = x * y if found[i + j] is None else found[i + j] + x * y
    return found


def _sum(*terms: Polynomial) -> Polynomial:
    longest = max(terms, key=len)
    zero = 0 * longest[0]
    return [sum((each[k] for each in terms if k < len(each)), zero) for k in range(len(longest))]


def _range(X: Polynomial) -> arb_mat:
    """Everything that it takes for |s| <= 1."""
    return sum((map_entries(symmetric, x) for x in X[1:]), X[0])
