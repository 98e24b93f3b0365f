"""The mistake in a wrong critic, where its numbers identify one."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterable
from itertools import chain

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import relative_residual
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.gare_schur import quick_solution
from hfa_support.errors import NoSolutionError
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import input_weights, relative_error, value_errors
from verification.critic.discrete_answers import discrete_answers
from verification.critic.other_actuators import answers_with_other_actuators, without_positions
from verification.critic.other_games import (
    OtherGame,
    game_at_another_angle,
    game_of_both,
    games_of_gain,
    games_of_value,
    printed_games,
)
from verification.critic.repairs import REDUNDANT, Repair, repaired_gain, repaired_value, repaired_weights, rescaled

#: A cause must explain the error down to this part of it. Noise in tens of entries cannot be explained by one number.
EXPLAINED = 1e-3
#: Below this part of the error a critic is the other game's; above it, a game that is like it would look the same.
_SAME = 1e-6
#: Above this part of the error a game is none of those asked for, and need not be solved to the last digit.
_FAR = 10.0 * EXPLAINED
#: Games that explain all of the error but this explain it equally well.
_ROUNDING = 1e-9
#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
_NOT_TOGETHER = "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
_WITH_ANOTHER_R = "K is not R⁻¹B'P: it is that of the stored P {}"


def diagnose(
    game: Game,
    exact: GameSolution,
    candidate: Candidate,
    limit: float,
    at_dihedral: Callable[[float], Game] | None = None,
) -> str:
    """One sentence that names the mistake which this critic makes, or "" when none is recognized.

    A mistake is named when the critic without it (`repairs`), or the answer of the game that it implies
    (`other_games`), is the same but for `EXPLAINED` of the error.
    """
    P, K = candidate.P, candidate.K
    if P is None:
        return (
            _of_gain(game, exact, K)
            or _in_other_units(game, exact, None, K)
            or _of_another_game(game, exact, None, K, at_dihedral).format("gain")
        )
    symmetric = (P + P.T) / 2.0
    together = _gain_error(game, K, game.gain(P)) <= limit
    if all(check.ok for check in value_errors(game, P, exact.P, limit)):
        return (
            _beyond(candidate)
            or _of_gain(game, exact, K)
            or ("" if together else _with_another_R(game, P, K) or _NOT_TOGETHER)
        )
    return (
        ("" if relative_error(P, P.T) <= limit else "P is not symmetric: the value z'Pz depends on (P + P')/2 alone")
        or _of_value(game, exact, candidate, symmetric)
        or ("" if together else _of_both(game, exact, symmetric, K, at_dihedral) or _NOT_TOGETHER)
        or _in_other_units(game, exact, symmetric, K)
        or _of_another_game(game, exact, symmetric, K, at_dihedral).format("solution")
        or _another_root(game, symmetric)
    )


def _value_error(game: Game, P: np.ndarray, exact: np.ndarray) -> float:
    squared = np.outer(units := balanced_units(game), units)
    return relative_error(P * squared, exact * squared)


def _gain_error(game: Game, K: np.ndarray, exact: np.ndarray) -> float:
    units, weights = balanced_units(game), input_weights(game)
    return relative_error(weights @ K * units, weights @ exact * units)


def _first(repairs: Iterable[Repair], error: Callable[[np.ndarray], float], before: float) -> str:
    """The mistake of the first repair that leaves `EXPLAINED` of the error."""
    allowed = EXPLAINED * min(before, 1.0)
    return next((repair.mistake for repair in repairs if error(repair.matrix) <= allowed), "")


def _of_value(game: Game, exact: GameSolution, candidate: Candidate, P: np.ndarray) -> str:
    """P: (n, n) symmetric."""
    repairs: Iterable[Repair] = repaired_value(P, exact.P, balanced_units(game))
    if candidate.weights is not None:
        functions = candidate.functions
        repairs = chain(repaired_weights(candidate.weights, functions.weights(exact.P), functions), repairs)
    return _first(repairs, lambda repaired: _value_error(game, repaired, exact.P), _value_error(game, P, exact.P))


def _of_gain(game: Game, exact: GameSolution, K: np.ndarray) -> str:
    scales = np.sqrt(np.diag(game.R))[:, None] * balanced_units(game)
    repairs = chain(repaired_gain(K, exact.K, game.R, scales), (Repair(*each) for each in without_positions(game, K)))
    return _first(repairs, lambda repaired: _gain_error(game, repaired, exact.K), _gain_error(game, K, exact.K))


def _in_other_units(game: Game, exact: GameSolution, P: np.ndarray | None, K: np.ndarray) -> str:
    """P: (n, n) symmetric, or None and the gain is asked."""
    if P is None:
        before = _gain_error(game, K, exact.K)
        return _first(rescaled("K", K, exact.K), lambda repaired: _gain_error(game, repaired, exact.K), before)
    before = _value_error(game, P, exact.P)
    return _first(rescaled("P", P, exact.P), lambda repaired: _value_error(game, repaired, exact.P), before)


def _beyond(candidate: Candidate) -> str:
    """What is said of weights beyond the quadratic ones, where those are right."""
    beyond = candidate.functions.quadratic_size
    if candidate.weights is None or not candidate.weights[beyond:].any():
        return ""
    place = beyond + int(np.argmax(np.abs(candidate.weights[beyond:])))
    return (
        f"weight {place + 1} is {candidate.weights[place]:.6g}: on a linear plant the value is quadratic, and every "
        "weight beyond the quadratic ones must be 0"
    )


def _of_another_game(
    game: Game,
    exact: GameSolution,
    P: np.ndarray | None,
    K: np.ndarray,
    at_dihedral: Callable[[float], Game] | None,
) -> str:
    """Whose answer this is, if not the game's, with {} for what of it: of P, (n, n) symmetric, or without it of K."""

    def error(other: Game, value: np.ndarray) -> float:
        return _gain_error(game, K, other.gain(value)) if P is None else _value_error(game, P, value)

    before = min(error(game, exact.P), 1.0)

    def rest(other: Game) -> float:
        with contextlib.suppress(NoSolutionError, ValueError):  # then the exact solution decides
            if (quick := error(other, quick_solution(other)) / before) > _FAR:
                return quick
        try:
            return error(other, solve_game(other).P) / before
        except NoSolutionError:
            return math.inf

    lqr = rest(game.with_delta(math.inf)) if math.isfinite(game.delta) else math.inf
    if lqr <= _SAME:
        return f"this is the LQR {{}} (delta = inf), not the game's at delta = {game.delta:.6g}"
    told = np.count_nonzero(exact.K if P is None else np.triu(exact.P))
    if told >= 1 + REDUNDANT:  # a few numbers fit many games
        others = games_of_gain(game, K) if P is None else games_of_value(game, P)
        if at_dihedral is not None:
            others = chain(others, printed_games(game), game_at_another_angle(at_dihedral, P, K))
        fits = [(rest(other.game), other.difference) for other in others]
        best = min((left for left, _ in fits), default=math.inf)
        if best <= EXPLAINED * min(lqr, 1.0):
            difference = next(said for left, said in fits if left <= max(10.0 * best, _ROUNDING))
            return f"this is the {{}} of another game, {difference}"
        for said, answer in chain(answers_with_other_actuators(game, P, K), discrete_answers(game, P, K)):
            left = _gain_error(game, K, answer) if P is None else _value_error(game, P, answer)
            if left <= EXPLAINED * before * min(lqr, 1.0):
                return f"this is the {{}} of {said}"
    if lqr <= EXPLAINED:
        return "this is nearly the LQR {} (delta = inf): the disturbance is missing or far too weak (delta, E)"
    return ""


def _of_both(
    game: Game,
    exact: GameSolution,
    P: np.ndarray,
    K: np.ndarray,
    at_dihedral: Callable[[float], Game] | None,
) -> str:
    """Of which other game both are, where each alone names the same one."""
    if (other := _of_this_K(game, P, K)) is not None:
        with contextlib.suppress(NoSolutionError):
            if _value_error(game, P, solve_game(other.game).P) <= EXPLAINED * min(_value_error(game, P, exact.P), 1.0):
                return f"this is the solution and gain of another game, {other.difference}"
    found = _of_another_game(game, exact, P, K, at_dihedral)
    same = found and found == _of_another_game(game, exact, None, K, at_dihedral)
    return found.format("solution and gain") if same else ""


def _with_another_R(game: Game, P: np.ndarray, K: np.ndarray) -> str:
    """What is said of a K that another R makes of a P that is right."""
    other = _of_this_K(game, P, K)
    return "" if other is None else _WITH_ANOTHER_R.format(other.difference)


def _of_this_K(game: Game, P: np.ndarray, K: np.ndarray) -> OtherGame | None:
    """The game with another R of which K is R⁻¹B'P, but for `EXPLAINED` of what R of this game leaves."""
    other = game_of_both(game, P, K)
    if other is None:
        return None
    allowed = EXPLAINED * min(_gain_error(game, K, game.gain(P)), 1.0)
    return other if _gain_error(game, K, other.game.gain(P)) <= allowed else None


def _another_root(game: Game, P: np.ndarray) -> str:
    units = balanced_units(game)
    residual = relative_residual(in_units(game, units), P * np.outer(units, units))
    abscissa = spectrum(game.A - game.S @ P).abscissa
    if residual > _ROOT or abscissa < 0.0:
        return ""
    return (
        f"this is another root of the Riccati equation: its residual is {residual:.2g}, but A - S P is not Hurwitz "
        f"(abscissa {abscissa:+.3g} 1/s)"
    )
