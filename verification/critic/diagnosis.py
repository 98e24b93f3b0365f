"""The mistake in a wrong critic, where its numbers identify one.

A repair is a guess from the critic's own numbers. Another game (another δ, Q, R, matrices or dihedral angle) is found
by a search along one parameter, and solved. A mistake is named only when the repaired critic, or the answer of the
other game, is the exact one but for `EXPLAINED` of the error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import relative_residual
from controller.riccati.gare import GameSolution, solve_game
from controller.riccati.gare_schur import quick_solution
from controller.riccati.smallest_delta import minimum_delta
from hfa_model.printed_matrices import published_models
from hfa_support.errors import BadInputError, NoSolutionError
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import input_weights, relative_error, value_errors

#: A cause must explain the error down to this part of it. Noise in tens of entries cannot be explained by one number.
EXPLAINED = 1e-3
#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
#: A factor this near to a power of ten, in decades, is that power.
_NEAR = 1e-3
_DEGREES = 180.0 / math.pi
_NOT_TOGETHER = "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
#: Numbers of a critic beyond the one that is solved for; one alone would fit by chance.
_REDUNDANT = 2
#: Where a search along one parameter begins: factors of its value in the game, and angles in degrees (none at 0, where
#: the matrices of the aircraft are stationary).
_FACTORS = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
_ANGLES = (1.0, 3.0, 5.0, 8.0, 12.0, 16.0, 20.0)
_STEPS, _STEP = 30, 1e-5
#: Where there is no game, as a difference: so many times that of the start.
_NO_GAME = 1e3
#: A search must take the difference down to this part of the best start's, or to rounding.
_REACHED, _ROUNDING = 0.1, 1e-9
#: Below this part of the error a critic is the LQR; above it, a game that is like it would look the same.
_SAME = 1e-6
#: The mistake in words, and P (n, n) or K (m, n) without it.
Repair = tuple[str, np.ndarray]
GameAt = Callable[[float], Game]


def diagnose(
    game: Game, exact: GameSolution, candidate: Candidate, limit: float, at_dihedral: GameAt | None = None
) -> str:
    """One sentence that names the mistake which this critic makes, or "" when none is recognized.

    limit: of the errors. at_dihedral: degrees -> the game there, to recognize a critic of another angle.
    """
    P, K = candidate.P, candidate.K
    if P is None:
        return _repaired_gain(game, K, exact.K) or _another_game(game, exact, None, K, at_dihedral)
    together = _gain_error(game, K, game.gain(P)) <= limit
    if all(check.ok for check in value_errors(game, P, exact.P, limit)):
        beyond = candidate.functions.quadratic_size
        if candidate.weights is not None and candidate.weights[beyond:].any():
            place = beyond + int(np.argmax(np.abs(candidate.weights[beyond:])))
            return (
                f"weight {place + 1} is {candidate.weights[place]:.6g}: on a linear plant the value is quadratic, and "
                "every weight beyond the quadratic ones must be 0"
            )
        return _repaired_gain(game, K, exact.K) or ("" if together else _NOT_TOGETHER)
    if relative_error(P, P.T) > limit:
        return "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
    P = (P + P.T) / 2.0
    repairs = repairs_of_value(P, exact.P)
    if candidate.weights is not None:
        repairs = itertools.chain(repairs_of_weights(candidate.weights, exact.P, candidate.functions), repairs)
    named = _first(repairs, lambda each: _value_error(game, each, exact.P), P)
    if named:
        return named
    found = _another_game(game, exact, P, K, at_dihedral)
    if not together:
        both = found and found.replace("solution", "gain") == _another_game(game, exact, None, K, at_dihedral)
        return found.replace("solution", "solution and gain") if both else _NOT_TOGETHER
    return found or _another_root(game, P)


def _first(repairs: Iterable[Repair], error: Callable[[np.ndarray], float], given: np.ndarray) -> str:
    """The mistake of the first repair that leaves `EXPLAINED` of the error of what was given, or ""."""
    allowed = EXPLAINED * min(error(given), 1.0)
    return next((mistake for mistake, matrix in repairs if error(matrix) <= allowed), "")


def _repaired_gain(game: Game, K: np.ndarray, exact: np.ndarray) -> str:
    return _first(repairs_of_gain(game, K, exact), lambda each: _gain_error(game, each, exact), K)


def _value_error(game: Game, P: np.ndarray, exact: np.ndarray) -> float:
    """|P - exact| / |exact| in balanced units, Frobenius."""
    squared = np.outer(units := balanced_units(game), units)
    return relative_error(P * squared, exact * squared)


def _gain_error(game: Game, K: np.ndarray, exact: np.ndarray) -> float:
    """|K - exact| / |exact| in balanced units, R^(1/2) K U, Frobenius."""
    units, weights = balanced_units(game), input_weights(game)
    return relative_error(weights @ K * units, weights @ exact * units)


def repairs_of_weights(weights: np.ndarray, exact: np.ndarray, functions: Basis) -> Iterator[Repair]:
    """Products z_i z_j column by column, without their factor 2, or two in each other's place; weights: (M,)."""
    row, column = np.triu_indices(functions.states)
    given, known = (each[: functions.quadratic_size] for each in (weights, functions.weights(exact)))
    twice, placed = np.where(row == column, 1.0, 2.0), np.empty_like(given)
    placed[np.lexsort((row, column))] = given
    by_column, lack = "stand column by column", "lack the factor 2 of products z_i z_j"
    yield f"the weights {by_column}; they must go row by row, i <= j", functions.matrix(placed)
    yield f"the weights {lack}; they are 2 P_ij", functions.matrix(twice * given)
    yield f"the weights {by_column} and {lack}; they must go row by row, i <= j", functions.matrix(twice * placed)
    wrong = np.sort(np.argsort(np.abs(given - known), kind="stable")[-2:])
    if len(given) > 1:
        swapped = given.copy()
        swapped[wrong] = given[wrong[::-1]]
        yield f"weights {wrong[0] + 1} and {wrong[1] + 1} are interchanged", functions.matrix(swapped)


def repairs_of_value(P: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """Of a symmetric P, (n, n): sign, factor, factor 2 beside the diagonal, order, signs and degrees of states."""
    yield "the value has the wrong sign", -P
    yield "the value is half the exact one: V here is z'Pz of the cost without a factor 1/2", 2.0 * P
    yield "the value is twice the exact one: V here is z'Pz of the cost without a factor 2", P / 2.0
    yield from _one_factor("P", P, exact, int(np.count_nonzero(np.triu(exact))))
    off = np.where(np.eye(len(P), dtype=bool), 1.0, 0.5)
    yield "P has entries beside the diagonal of twice their size: they are W / 2", P * off
    order = _order(np.diag(P), np.diag(exact))
    yield f"the states are in the order {_listed(order)}", _placed(_placed(P, order).T, order).T
    row = int(np.argmax(np.diag(exact)))
    flipped = P[row] * exact[row] < 0.0
    signs = np.where(~flipped if 2 * flipped.sum() > len(P) else flipped, -1.0, 1.0)
    if flipped.any():
        yield f"{_named('state', signs < 0.0)} of the other sign", P * np.outer(signs, signs)
    with np.errstate(divide="ignore", invalid="ignore"):
        factors = np.sqrt(np.diag(P) / np.diag(exact))
    for said, units in _degrees("state", factors, 1.0 / _DEGREES):
        yield said, P / np.outer(units, units)


def repairs_of_gain(game: Game, K: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """Of K, (m, n): sign, factor, R⁻¹, transposition, order, signs and degrees of inputs and states."""
    m, n = K.shape
    yield "the gain has the wrong sign: the policy is u = -K z", -K
    yield "the gain is half the exact one", 2.0 * K
    yield "the gain is twice the exact one", K / 2.0
    if m == n:
        yield "K is transposed", K.T
    yield "R⁻¹ is missing: this is B'P, and K is R⁻¹B'P", np.linalg.solve(game.R, K)
    yield from _one_factor("K", K, exact, int(np.count_nonzero(exact)))
    yield "K was read row by row, its entries stand column by column", K.reshape(n, m).T
    for kind, axis, degree in (("input", 1, _DEGREES), ("state", 0, 1.0 / _DEGREES)):
        order = _order(np.linalg.norm(K, axis=axis), np.linalg.norm(exact, axis=axis))
        placed = _placed(K, order) if axis else _placed(K.T, order).T
        yield f"the {kind}s are in the order {_listed(order)}", placed
        flipped = np.sum(K * exact, axis=axis) < 0.0
        if flipped.any():
            verb = "has" if flipped.sum() == 1 else "have"
            said = _named(kind, flipped).rpartition(" ")[0]
            yield f"{said} {verb} the wrong sign", K * np.expand_dims(np.where(flipped, -1.0, 1.0), axis)
        with np.errstate(divide="ignore", invalid="ignore"):
            factors = np.sum(K * exact, axis=axis) / np.sum(exact * exact, axis=axis)
        for said, units in _degrees(kind, factors, degree):
            yield said, K / np.expand_dims(units, axis)


def _one_factor(name: str, matrix: np.ndarray, exact: np.ndarray, known: int) -> Iterator[Repair]:
    """The factor that least squares give, where enough of the known numbers test it."""
    factor = float(np.sum(matrix * exact) / (np.sum(exact * exact) or 1.0))
    if not (math.isfinite(factor) and factor != 0.0):
        return
    decades = math.log10(abs(factor))
    if factor > 0.0 and round(decades) and abs(decades - round(decades)) < _NEAR:
        factor = 10.0 ** round(decades)
    elif known < 1 + _REDUNDANT:
        return
    yield f"every entry of {name} is {factor:.6g} times the exact one", matrix / factor


def _degrees(kind: str, factors: np.ndarray, degree: float) -> Iterator[tuple[str, np.ndarray]]:
    """Some states or inputs, not all, in degrees: the mistake, and the factors (n,) that remove it.

    factors: of each state or input, as they look. degree: what one in degrees has.
    """
    angles = np.abs(np.log(np.abs(np.where(factors == 0.0, np.nan, factors)) / degree)) < 0.1
    if angles.any() and not angles.all():
        yield f"{_named(kind, angles)} in degrees", np.where(angles, degree, 1.0)


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


def _another_game(
    game: Game, exact: GameSolution, P: np.ndarray | None, K: np.ndarray, at_dihedral: GameAt | None
) -> str:
    """Whose solution P (n, n) is, symmetric, or without it whose gain K is; "" when no game explains the error."""

    def error(other: Game, value: np.ndarray) -> float:
        return _gain_error(game, K, other.gain(value)) if P is None else _value_error(game, P, value)

    before, what = min(error(game, exact.P), 1.0), "gain" if P is None else "solution"

    def rest(other: Game) -> float:
        try:
            return error(other, solve_game(other).P) / before
        except NoSolutionError:
            return math.inf

    lqr = rest(game.with_delta(math.inf)) if math.isfinite(game.delta) else math.inf
    if lqr <= _SAME:
        return f"this is the LQR {what} (delta = inf), not the game's at delta = {game.delta:.6g}"
    if np.count_nonzero(exact.K if P is None else np.triu(exact.P)) < 1 + _REDUNDANT:  # a few numbers fit many games
        return ""
    fits = [(rest(other), said) for said, other in _other_games(game, P, K, at_dihedral)]
    best = min((left for left, _ in fits), default=math.inf)
    if best > EXPLAINED * min(lqr, 1.0):
        return ""
    difference = next(said for left, said in fits if left <= max(10.0 * best, _ROUNDING))
    return f"this is the {what} of another game, {difference}"


def _other_games(
    game: Game, P: np.ndarray | None, K: np.ndarray, at_dihedral: GameAt | None
) -> Iterator[tuple[str, Game]]:
    """Games with another delta, with Q or R scaled, of the aircraft printed or at another angle, whose answer this may
    be: what differs, and the game."""
    logs = [math.log(factor) for factor in _FACTORS]
    families: list[tuple[str, Callable[[float], float], GameAt, list[float]]] = [
        ("with Q {:.4g} times as large", math.exp, lambda x: replace(game, Q=math.exp(x) * game.Q), logs),
        ("with R {:.4g} times as large", math.exp, lambda x: replace(game, R=math.exp(x) * game.R), logs),
    ]
    if (size := game.delta if math.isfinite(game.delta) else minimum_delta(game).value) > 0.0:

        def delta(x: float) -> float:  # P and K are smooth in x = 1/δ², relative
            return size / math.sqrt(x)

        families.insert(0, ("at delta = {:.4g}", delta, lambda x: game.with_delta(delta(x)), list(_FACTORS)))
    if at_dihedral is not None:
        families.append(("at dihedral {:.4f} deg", float, at_dihedral, list(_ANGLES)))
        for printed in published_models():
            if printed.B.shape == game.B.shape:
                said = f"of the matrices printed for {printed.dihedral_deg:g} deg"
                yield said, replace(game, A=printed.A, B=printed.B)
    for said, value, game_at, starts in families:
        found = _searched(game_at, starts, P, K)
        if found is not None:
            yield said.format(value(found)), game_at(found)


def _searched(game_at: GameAt, starts: list[float], P: np.ndarray | None, K: np.ndarray) -> float | None:
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


def _order(given: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """order with given[i] = exact[order[i]], from the sizes."""
    order = np.empty(len(given), dtype=int)
    order[np.argsort(given)] = np.argsort(exact)
    return order


def _placed(matrix: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Row i of the matrix in place order[i]."""
    placed = np.empty_like(matrix)
    placed[order] = matrix
    return placed


def _listed(order: np.ndarray) -> str:
    return ", ".join(str(place + 1) for place in order)


def _named(kind: str, where: np.ndarray) -> str:
    """'state 2 is', 'states 2, 3 and 5 are'."""
    places = [str(place + 1) for place in np.flatnonzero(where)]
    if len(places) == 1:
        return f"{kind} {places[0]} is"
    return f"{kind}s {', '.join(places[:-1])} and {places[-1]} are"
