"""Of which other game a critic is the answer: another delta, Q, R or dihedral angle, solved for.

A value P belongs to A, B, E with weights that its Riccati equation gives linearly:
A'P + P A + Σ q_i e_i e_i' - P (Σ r_j⁻¹ b_j b_j' - δ⁻² E E') P = 0. A gain, and a dihedral angle, are searched for along
one parameter. Either guess is then solved as a game of its own, and only its answer counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.gare_schur import quick_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.printed_matrices import published_models
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.actuated import actuators_in, with_speed
from verification.critic.critic_errors import input_weights
from verification.critic.repairs import REDUNDANT

#: Where a search along one parameter begins: factors of its value in the game, and angles in degrees.
FACTORS = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
ANGLES = (0.0, 4.0, 8.0, 12.0, 16.0, 20.0)
_STEPS = 30
_STEP = 1e-5
#: Where there is no game, as a difference: so many times that of the start.
_NO_GAME = 1e3
#: A difference as small as this is none, and cannot be brought to a part of itself.
_ROUNDING = 1e-9
#: Factors of the inputs that differ by less, relative, are one.
SAME_FACTOR = 1e-6
_Made = TypeVar("_Made")
REACHED = 0.1


class OtherGame(NamedTuple):
    """In words what differs, and the game."""

    difference: str
    game: Game


def games_of_value(game: Game, P: np.ndarray) -> Iterator[OtherGame]:
    """Games with another delta, Q or R whose value may be P, (n, n)."""
    units = balanced_units(game)
    there, P = in_units(game, units), P * np.outer(units, units)
    linear = there.A.T @ P + P @ there.A
    size = game.delta if math.isfinite(game.delta) else 1.0
    control, opposed = P @ there.S_control @ P, P @ there.S_disturbance @ P / size**2
    disturbance = opposed if math.isfinite(game.delta) else np.zeros_like(opposed)
    if opposed.any():
        found = _fitted([opposed], linear + there.Q - control)
        if found is not None and found[0] > 0.0:
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
            Q = np.diag(found / units**2)
            yield from _other(f"with Q = diag({_entries(np.diag(Q))})", game, Q=Q)
    if _diagonal(game.R) and len(game.R) > 1:
        columns = (P @ there.B).T
        found = _fitted([-np.outer(column, column) for column in columns], linear + there.Q + disturbance)
        if found is not None and np.all(found > 0.0):
            yield from _other(f"with R = diag({_entries(1.0 / found)})", game, R=np.diag(1.0 / found))


def games_of_gain(game: Game, K: np.ndarray) -> Iterator[OtherGame]:
    """Games with another delta, with Q or R scaled, or with faster actuators, whose gain may be K, (m, n)."""
    logs = [math.log(factor) for factor in FACTORS]
    families: list[tuple[str, Callable[[float], float], Callable[[float], Game], list[float]]] = [
        ("with Q {:.4g} times as large", math.exp, lambda x: replace(game, Q=math.exp(x) * game.Q), logs),
        ("with R {:.4g} times as large", math.exp, lambda x: replace(game, R=math.exp(x) * game.R), logs),
    ]
    if (size := game.delta if math.isfinite(game.delta) else minimum_delta(game).value) > 0.0:

        def delta(x: float) -> float:  # K is smooth in x = 1/δ², relative
            return size / math.sqrt(x)

        families.insert(0, ("at delta = {:.4g}", delta, lambda x: game.with_delta(delta(x)), list(FACTORS)))
    if (actuators := actuators_in(game)).inputs:
        said = "with actuators {:.4g} times as fast"
        families.append((said, math.exp, lambda x: with_speed(game, actuators, math.exp(x)), logs[2:-2]))
    for said, value, game_at, starts in families:
        found = searched(game_at, starts, lambda other: _gain_difference(other, K))
        if found is not None:
            yield OtherGame(said.format(value(found)), game_at(found))


def game_of_both(game: Game, P: np.ndarray, K: np.ndarray) -> OtherGame | None:
    """The game with another R, scaled as a whole or input by input, by which K, (m, n), would be R⁻¹B'P of P, (n, n).

    Only a guess: factors of the rows of K, by least squares.
    """
    claimed = game.gain(P)
    squares = (claimed**2).sum(axis=1)
    if np.count_nonzero(claimed) < len(K) + REDUNDANT or not squares.all():
        return None
    shares = (claimed * K).sum(axis=1) / squares
    if not np.all(shares > 0.0):
        return None
    if np.ptp(shares) <= SAME_FACTOR * shares.max():
        scale = 1.0 / float(shares.mean())
        return next(_other(f"with R {scale:.4g} times as large", game, R=scale * game.R), None)
    if not _diagonal(game.R):
        return None
    R = np.diag(game.R) / shares
    return next(_other(f"with R = diag({_entries(R)})", game, R=np.diag(R)), None)


def printed_games(game: Game) -> Iterator[OtherGame]:
    """The printed pairs (A, B) under the weights of a game of the aircraft."""
    for printed in published_models():
        if printed.B.shape == game.B.shape:
            yield from _other(
                f"of the matrices printed for {printed.dihedral_deg:g} deg", game, A=printed.A, B=printed.B
            )


def game_at_another_angle(
    at_dihedral: Callable[[float], Game], P: np.ndarray | None, K: np.ndarray
) -> Iterator[OtherGame]:
    """The game at the dihedral angle whose value may be P, (n, n), or whose gain K, (m, n)."""
    angle = searched(
        at_dihedral,
        list(ANGLES),
        lambda other: _gain_difference(other, K) if P is None else value_error_of(other, quick_solution(other), P),
    )
    if angle is not None:
        yield OtherGame(f"at dihedral {angle:.4f} deg", at_dihedral(angle))


def searched(
    game_at: Callable[[float], _Made], starts: list[float], difference: Callable[[_Made], np.ndarray]
) -> float | None:
    """The parameter at which the difference is least, between the starts or as far beyond them; None when that is not
    `REACHED` of the best start's."""
    low, high = 2.0 * min(starts) - max(starts), 2.0 * max(starts) - min(starts)
    found = least(lambda at: game_at(float(at[0])), [np.array([each]) for each in starts], difference, (low, high))
    return float(found.at[0]) if found is not None and found.left <= max(REACHED * found.first, _ROUNDING) else None


class Least(NamedTuple):
    """Where a difference is least, how large it is there, and at the start."""

    at: np.ndarray
    left: float
    first: float


def least(
    game_at: Callable[[np.ndarray], _Made],
    starts: list[np.ndarray],
    difference: Callable[[_Made], np.ndarray],
    within: tuple[float, float] = (-math.inf, math.inf),
) -> Least | None:
    """By least squares from the best start, while a step takes a tenth off them; None where no start is a game."""
    from scipy.optimize import least_squares

    def at(value: np.ndarray) -> np.ndarray | None:
        try:
            with np.errstate(divide="raise", invalid="raise"):
                return np.ravel(difference(game_at(value)))
        except (NoSolutionError, BadInputError, ValueError, ArithmeticError):  # no such game
            return None

    tried = [(float(np.linalg.norm(found)), start, found) for start in starts if (found := at(start)) is not None]
    if not tried:
        return None
    first, start, there = min(tried, key=lambda each: each[0])
    nowhere = np.full_like(there, _NO_GAME * max(first, _ROUNDING))
    found = least_squares(
        lambda value: nowhere if (here := at(value)) is None else here,
        start,
        bounds=within,
        ftol=0.1,
        xtol=1e-14,
        gtol=1e-15,
        diff_step=_STEP,
        max_nfev=_STEPS,
    )
    return Least(found.x, float(np.linalg.norm(found.fun)), first)


def _gain_difference(game: Game, K: np.ndarray) -> np.ndarray:
    return gain_error_of(game, game.gain(quick_solution(game)), K)


def difference_of(game: Game, P: np.ndarray | None, K: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """From an answer of another game to its difference from P, (n, n), or where that is None from K, (m, n)."""
    return lambda answer: gain_error_of(game, answer, K) if P is None else value_error_of(game, answer, P)


def value_error_of(game: Game, exact: np.ndarray, P: np.ndarray) -> np.ndarray:
    """(exact - P) in balanced units over the size of the exact one, (n, n)."""
    squared = np.outer(units := balanced_units(game), units)
    return np.asarray((exact - P) * squared / np.linalg.norm(exact * squared))


def gain_error_of(game: Game, exact: np.ndarray, K: np.ndarray) -> np.ndarray:
    """(exact - K) in balanced units over the size of the exact one, (m, n)."""
    units, weights = balanced_units(game), input_weights(game)
    return np.asarray(weights @ (exact - K) * units / np.linalg.norm(weights @ exact * units))


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
        yield OtherGame(difference, replace(game, **changes))  # type: ignore[arg-type]
    except BadInputError:
        return  # such weights make no game


def _diagonal(matrix: np.ndarray) -> bool:
    return bool(np.array_equal(matrix, np.diag(np.diag(matrix))))


def _entries(values: np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)
