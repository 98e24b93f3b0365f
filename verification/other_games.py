"""Search for another game of which a critic is exact: one that differs by a single number."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game, rates_of_step
from controller.riccati.candidate import value_in_doubles
from controller.riccati.gare import Solution, solve
from controller.riccati.lyapunov import FailedError
from hfa_support.errors import BadInputError, NoSolutionError

#: Logarithms of the numbers that are tried first, relative to the one in the middle.
_GRID = np.linspace(-3.0, 3.0, 37) * math.log(10.0)
#: Games with more states are not searched: it takes a few hundred solutions.
MOST_STATES = 16
#: Accuracy of the logarithm of the number, with which P and K are right within the usual limit.
_ACCURACY = 1e-9
#: Largest number of steps, which converge quadratically; parts of a step that are tried; change of
#: the logarithm that gives slopes.
_STEPS = 20
_PARTS = (1.0, 0.5, 0.25, 0.125)
_DIFFERENCE = 1e-6


class Family(NamedTuple):
    """Games that differ by one number.

    says: number -> sentence that a matrix is exact for it, after "K is"
    middle: number about which others are tried, by factors up to 1000
    game: number -> the game; raises BadInputError if there is none
    """

    says: Callable[[float], str]
    middle: float
    game: Callable[[float], Game]


def other_games(
    exact: Solution, of: str, given: np.ndarray, sizes: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield games that differ by one number, whose exact P or K is nearest to that of a critic.

    Each is a sentence that follows "K is", and the exact P or K of the game.

    exact: solution of the game
    of: "P" or "K"
    given: P or K of the critic
    sizes: sizes of the entries of `given`, which change with the units as the entries do
    """
    if len(given.T) > MOST_STATES or not given.any():
        return
    game, plant = exact.game, continuous(exact.game)
    others = {}
    if np.isfinite(game.delta) and game.E.any():
        others["exact without disturbance (delta inf)"] = game.with_delta(math.inf)
    if game.discount < 1.0:
        says = f"exact without discount, not for discount {game.discount:.6g}"
        others[says] = replace(game, discount=1.0)
    if plant is not None:
        others["exact for the game in continuous time"] = plant
    for says, other in others.items():
        with suppress(NoSolutionError):
            yield says, getattr(solve(other), of)
    for family in _families(exact, plant):
        found = _nearest(family, of, given, sizes)
        if found is not None:
            yield found


def _families(exact: Solution, plant: Game | None) -> Iterator[Family]:
    """Yield the families of a game: other delta, R, sample time and discount."""
    game = exact.game
    if game.E.any():
        has_delta = math.isfinite(game.delta)
        instead = f", not {game.delta:.4g}" if has_delta else ""
        with suppress(NoSolutionError):  # where the smallest delta is not decided
            middle = game.delta if has_delta else max(exact.delta_min, np.finfo(float).tiny)
            yield Family(
                lambda delta: f"exact for delta {delta:.4g}{instead}", middle, game.with_delta
            )
    if not game.N.any():
        yield Family(
            lambda factor: f"exact for R {factor:.4g} times as large",
            1.0,
            lambda factor: replace(game, R=factor * game.R),
        )
    if not game.is_discrete:
        # The search begins at a sample time of a tenth of the fastest time constant.
        fastest = float(np.abs(exact.poles()).max())  # of a stable loop, not 0
        yield Family(
            lambda dt: f"exact for the game sampled with dt {dt:.4g} s", 0.1 / fastest, game.sampled
        )
        return
    less_than_1 = (1.0 - game.discount) or 0.01  # about a discount of 1, 0.99 is the middle
    yield Family(
        lambda less: f"exact for discount {1.0 - less:.6g}, not {game.discount:.6g}",
        less_than_1,
        lambda less: replace(game, discount=1.0 - less),
    )
    if plant is not None:
        yield Family(
            lambda dt: f"exact for dt {dt:.4g} s, not {game.dt:.4g} s",
            float(game.dt or 0.0),
            lambda dt: plant.sampled(dt, game.discount),
        )


def continuous(game: Game) -> Game | None:
    """Return the game in continuous time of which a game is sampled, or None if none is known."""
    if not isinstance(game.dt, float):
        return None  # in continuous time, or in steps of unknown duration
    n, m = game.B.shape
    try:
        rates = rates_of_step(np.hstack([game.A, game.B, game.E]), game.dt)
    except (ValueError, np.linalg.LinAlgError):
        return None
    if rates is None:
        return None
    A, B, E = np.split(rates, [n, n + m], axis=1)
    # A step costs as much as dt seconds; delta² is a weight, too.
    weights = {name: getattr(game, name) / game.dt for name in "QRN"}
    delta = game.delta / math.sqrt(game.dt)
    try:
        return Game(A, B, E=E, delta=delta, names=game.names, **weights)
    except BadInputError:  # R is singular
        return None


def _nearest(
    family: Family, of: str, given: np.ndarray, sizes: np.ndarray
) -> tuple[str, np.ndarray] | None:
    """Return a sentence on the game of a family with the nearest P or K, and this matrix, or None.

    The number is searched on a grid of factors, then by Gauss and Newton.
    """

    def game_at(logarithm: float) -> Game:
        return family.game(family.middle * math.exp(logarithm))

    def errors_at(logarithm: float) -> np.ndarray:
        """Return the errors of the P or K of a game against the given one, or inf without value."""
        with suppress(FailedError, BadInputError), np.errstate(all="ignore"):
            return (_candidate(game_at(logarithm), of) - given) / sizes
        return np.full(given.shape, math.inf)

    norm = np.linalg.norm
    errors_on_grid = [errors_at(logarithm) for logarithm in _GRID]
    best = int(np.argmin(np.nan_to_num([*map(norm, errors_on_grid)], nan=math.inf)))
    if not (np.isfinite(norm(errors_on_grid[best])) and 0 < best < len(_GRID) - 1):
        return None  # no game has a value, or the nearest one is beyond an end of the grid
    logarithm, errors, longest_step = _GRID[best], errors_on_grid[best], _GRID[1] - _GRID[0]
    for _ in range(_STEPS):  # of Gauss and Newton
        with np.errstate(all="ignore"):  # a slope of inf or 0 ends the search
            slope = (errors_at(logarithm + _DIFFERENCE) - errors) / _DIFFERENCE
            step = np.clip(
                -np.vdot(slope, errors) / np.vdot(slope, slope), -longest_step, longest_step
            )
        if not abs(step) > _ACCURACY:
            break
        for part in _PARTS:
            if norm(after := errors_at(logarithm + part * step)) < norm(errors):
                break
        else:
            break  # no part of the step comes nearer
        logarithm, errors = logarithm + part * step, after
    with suppress(NoSolutionError, BadInputError):
        nearest = getattr(solve(game_at(logarithm)), of)
        return family.says(family.middle * math.exp(logarithm)), nearest
    return None


def _candidate(game: Game, of: str) -> np.ndarray:
    """Return P or K of a game in doubles, which nothing proves."""
    P = value_in_doubles(game)
    return P if of == "P" else game.gain(P)
