"""Of which other game a critic is the answer: the LQR, another delta, Q, R or dihedral angle, solved for.

A value P belongs to A, B, E with weights that its Riccati equation gives linearly:
A'P + P A + Σ q_i e_i e_i' - P (Σ r_j⁻¹ b_j b_j' - δ⁻² E E') P = 0. A gain, and a dihedral angle, are searched for along
one parameter. Either guess is then solved as a game of its own, and only its answer counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.gare_schur import quick_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.printed_matrices import published_models
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.critic_errors import input_weights, relative_error

#: Numbers of a critic beyond those that are solved for; one alone would fit by chance.
REDUNDANT = 2
#: Where a search along one parameter begins: factors of its value in the game, and angles in degrees (none at 0, where
#: the matrices of the aircraft are stationary).
FACTORS = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
ANGLES = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)
_STEPS, _STEP = 30, 1e-5
#: Where there is no game, as a difference: so many times that of the start.
_NO_GAME = 1e3
#: A search must take the difference down to this part of the best start's, or to rounding.
_REACHED, _ROUNDING = 0.1, 1e-9
#: Below this part of the error a critic is the LQR; above it, a game that is like it would look the same.
_SAME = 1e-6
#: In words what differs, and the game.
OtherGame = tuple[str, Game]


def value_error(game: Game, P: np.ndarray, exact: np.ndarray) -> float:
    """|P - exact| / |exact| in balanced units, Frobenius."""
    squared = np.outer(units := balanced_units(game), units)
    return relative_error(P * squared, exact * squared)


def gain_error(game: Game, K: np.ndarray, exact: np.ndarray) -> float:
    """|K - exact| / |exact| in balanced units, R^(1/2) K U, Frobenius."""
    units, weights = balanced_units(game), input_weights(game)
    return relative_error(weights @ K * units, weights @ exact * units)


def another_game(
    game: Game,
    exact: GameSolution,
    P: np.ndarray | None,
    K: np.ndarray,
    explained: float,
    at_dihedral: Callable[[float], Game] | None,
) -> str:
    """Whose solution P (n, n) is, symmetric, or without it whose gain K is; "" when no game explains the error.

    explained: the part of the error that the answer of the other game may leave.
    """

    def error(other: Game, value: np.ndarray) -> float:
        return gain_error(game, K, other.gain(value)) if P is None else value_error(game, P, value)

    before, what = min(error(game, exact.P), 1.0), "gain" if P is None else "solution"

    def rest(other: Game) -> float:
        try:
            return error(other, solve_game(other).P) / before
        except NoSolutionError:
            return math.inf

    lqr = rest(game.with_delta(math.inf)) if math.isfinite(game.delta) else math.inf
    if lqr <= _SAME:
        return f"this is the LQR {what} (delta = inf), not the game's at delta = {game.delta:.6g}"
    if np.count_nonzero(exact.K if P is None else np.triu(exact.P)) >= 1 + REDUNDANT:  # a few numbers fit many games
        others = games_of_gain(game, K) if P is None else games_of_value(game, P)
        if at_dihedral is not None:
            others = chain(others, _printed(game), _at_another_angle(at_dihedral, P, K))
        fits = [(rest(other), said) for said, other in others]
        best = min((left for left, _ in fits), default=math.inf)
        if best <= explained * min(lqr, 1.0):
            difference = next(said for left, said in fits if left <= max(10.0 * best, _ROUNDING))
            return f"this is the {what} of another game, {difference}"
    if lqr <= explained:
        return f"this is nearly the LQR {what} (delta = inf): the disturbance is missing or far too weak (delta, E)"
    return ""


def games_of_value(game: Game, P: np.ndarray) -> Iterator[OtherGame]:
    """Games with another delta, Q or R whose value may be P, (n, n)."""
    units = balanced_units(game)
    there, P = in_units(game, units), P * np.outer(units, units)
    linear, size = there.A.T @ P + P @ there.A, game.delta if math.isfinite(game.delta) else 1.0
    control, opposed = P @ there.S_control @ P, P @ there.S_disturbance @ P / size**2
    disturbance = opposed if math.isfinite(game.delta) else np.zeros_like(opposed)
    found = _fitted([opposed], linear + there.Q - control)
    if opposed.any() and found is not None and found[0] > 0.0:
        delta = size / math.sqrt(found[0])
        yield from _other(f"at delta = {delta:.4g}", game, delta=delta)
    found = _fitted([there.Q], linear - control + disturbance)
    if found is not None:
        yield from _other(f"with Q {found[0]:.4g} times as large", game, Q=found[0] * game.Q)
    found = _fitted([-control], linear + there.Q + disturbance)
    if found is not None and found[0] > 0.0:
        yield from _other(f"with R {1.0 / found[0]:.4g} times as large", game, R=game.R / found[0])
    if _diagonal(game.Q):
        found = _fitted([np.diag(row) for row in np.eye(len(P))], linear - control + disturbance)
        if found is not None:
            Q = found / units**2
            yield from _other(f"with Q = diag({_entries(Q)})", game, Q=np.diag(Q))
    if _diagonal(game.R) and len(game.R) > 1:
        columns = (P @ there.B).T
        found = _fitted([-np.outer(column, column) for column in columns], linear + there.Q + disturbance)
        if found is not None and np.all(found > 0.0):
            yield from _other(f"with R = diag({_entries(1.0 / found)})", game, R=np.diag(1.0 / found))


def games_of_gain(game: Game, K: np.ndarray) -> Iterator[OtherGame]:
    """Games with another delta, or with Q or R scaled, whose gain may be K, (m, n)."""
    logs = [math.log(factor) for factor in FACTORS]
    families: list[tuple[str, Callable[[float], float], Callable[[float], Game], list[float]]] = [
        ("with Q {:.4g} times as large", math.exp, lambda x: replace(game, Q=math.exp(x) * game.Q), logs),
        ("with R {:.4g} times as large", math.exp, lambda x: replace(game, R=math.exp(x) * game.R), logs),
    ]
    if (size := game.delta if math.isfinite(game.delta) else minimum_delta(game).value) > 0.0:

        def delta(x: float) -> float:  # K is smooth in x = 1/δ², relative
            return size / math.sqrt(x)

        families.insert(0, ("at delta = {:.4g}", delta, lambda x: game.with_delta(delta(x)), list(FACTORS)))
    for said, value, game_at, starts in families:
        found = _searched(game_at, starts, None, K)
        if found is not None:
            yield said.format(value(found)), game_at(found)


def _printed(game: Game) -> Iterator[OtherGame]:
    """The printed pairs (A, B) under the weights of a game of the aircraft."""
    for printed in published_models():
        if printed.B.shape == game.B.shape:
            said = f"of the matrices printed for {printed.dihedral_deg:g} deg"
            yield from _other(said, game, A=printed.A, B=printed.B)


def _at_another_angle(at_dihedral: Callable[[float], Game], P: np.ndarray | None, K: np.ndarray) -> Iterator[OtherGame]:
    """The game at the dihedral angle whose value may be P, (n, n), or whose gain K, (m, n)."""
    angle = _searched(at_dihedral, list(ANGLES), P, K)
    if angle is not None:
        yield f"at dihedral {angle:.4f} deg", at_dihedral(angle)


def _searched(
    game_at: Callable[[float], Game], starts: list[float], P: np.ndarray | None, K: np.ndarray
) -> float | None:
    """The parameter at which the answer differs least from P, or without it from K, by least squares.

    It lies between the starts or as far beyond them. None when the difference does not fall to `_REACHED` of the best
    start's.
    """
    from scipy.optimize import least_squares

    def difference(parameter: float) -> np.ndarray | None:
        try:
            with np.errstate(divide="raise", invalid="raise"):
                game = game_at(parameter)
                found, units = quick_solution(game), balanced_units(game)
                if P is None:
                    weights, exact = input_weights(game), game.gain(found)
                    away, size = weights @ (exact - K) * units, weights @ exact * units
                else:
                    away, size = (found - P) * np.outer(units, units), found * np.outer(units, units)
                return np.ravel(away / np.linalg.norm(size))
        except (NoSolutionError, BadInputError, ValueError, ArithmeticError):  # no such game
            return None

    tried = [(float(np.linalg.norm(found)), at, found) for at in starts if (found := difference(at)) is not None]
    if not tried:
        return None
    first, start, there = min(tried, key=lambda each: each[0])
    nowhere = np.full_like(there, _NO_GAME * max(first, _ROUNDING))
    ends = 2.0 * min(starts) - max(starts), 2.0 * max(starts) - min(starts)
    found = least_squares(
        lambda at: nowhere if (here := difference(float(at[0]))) is None else here,
        [start],
        bounds=ends,
        ftol=0.1,
        xtol=1e-14,
        gtol=1e-15,
        diff_step=_STEP,
        max_nfev=_STEPS,
    )
    left = float(np.linalg.norm(found.fun))
    return float(found.x[0]) if left <= max(_REACHED * first, _ROUNDING) else None


def _fitted(columns: list[np.ndarray], rest: np.ndarray) -> np.ndarray | None:
    """x of the least squares Σ x_i column_i + rest = 0; None when fewer than `REDUNDANT` equations would test them."""
    entries = np.triu_indices(len(rest))
    matrix = np.array([column[entries] for column in columns]).T
    equations = np.count_nonzero(matrix.any(axis=1) | (rest[entries] != 0.0))
    if equations < matrix.shape[1] + REDUNDANT:
        return None
    return np.linalg.lstsq(matrix, -rest[entries], rcond=None)[0]


def _other(difference: str, game: Game, **changes: object) -> Iterator[OtherGame]:
    try:
        yield difference, replace(game, **changes)  # type: ignore[arg-type]
    except BadInputError:
        return  # such weights make no game


def _diagonal(matrix: np.ndarray) -> bool:
    return bool(np.array_equal(matrix, np.diag(np.diag(matrix))))


def _entries(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
