"""The mistake in a wrong critic, where its numbers identify one.

Each repair is a guess from the critic's own numbers, each other game (`other_games.py`) one that its Riccati equation
gives. A mistake is named only when the repaired critic, or the answer of that game, is the same but for `EXPLAINED` of
the error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from itertools import chain

import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units, spectrum
from controller.riccati.certificate import relative_residual
from controller.riccati.gare import GameSolution
from verification.critic.candidate import Candidate
from verification.critic.critic_errors import relative_error, value_errors
from verification.critic.other_games import REDUNDANT, another_game, gain_error, value_error

#: A cause must explain the error down to this part of it. Noise in tens of entries cannot be explained by one number.
EXPLAINED = 1e-3
#: A residual below this marks a root of the Riccati equation, if not the right one.
_ROOT = 1e-9
#: A ratio this near to a power of ten, in decades, is a decimal slip.
_NEAR = 1e-3
_DEGREES = 180.0 / math.pi
_NOT_TOGETHER = "K is not R⁻¹B'P: the stored K and P do not belong together, or not to this plant and R"
#: The mistake in words, and P (n, n) or K (m, n) without it.
Repair = tuple[str, np.ndarray]


def diagnose(
    game: Game,
    exact: GameSolution,
    candidate: Candidate,
    limit: float,
    at_dihedral: Callable[[float], Game] | None = None,
) -> str:
    """One sentence that names the mistake which this critic makes, or "" when none is recognized.

    limit: of the errors. at_dihedral: degrees -> the game there, to recognize a critic of another angle.
    """
    P, K = candidate.P, candidate.K
    if P is None:
        of_gain = _repaired(repaired_gain(game, K, exact.K), lambda each: gain_error(game, each, exact.K), K)
        return of_gain or another_game(game, exact, None, K, EXPLAINED, at_dihedral)
    together = gain_error(game, K, game.gain(P)) <= limit
    if all(check.ok for check in value_errors(game, P, exact.P, limit)):
        of_gain = _repaired(repaired_gain(game, K, exact.K), lambda each: gain_error(game, each, exact.K), K)
        return _beyond(candidate) or of_gain or ("" if together else _NOT_TOGETHER)
    if relative_error(P, P.T) > limit:
        return "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
    P = (P + P.T) / 2.0
    repairs = repaired_value(P, exact.P, balanced_units(game))
    if candidate.weights is not None:
        repairs = chain(repaired_weights(candidate.weights, exact.P, candidate.functions), repairs)
    named = _repaired(repairs, lambda each: value_error(game, each, exact.P), P)
    if named:
        return named
    found = another_game(game, exact, P, K, EXPLAINED, at_dihedral)
    if not together:
        both = found and found.replace("solution", "gain") == another_game(game, exact, None, K, EXPLAINED, at_dihedral)
        return found.replace("solution", "solution and gain") if both else _NOT_TOGETHER
    return found or _another_root(game, P)


def _repaired(repairs: Iterable[Repair], error: Callable[[np.ndarray], float], given: np.ndarray) -> str:
    """The mistake of the first repair that leaves `EXPLAINED` of the error of what was given."""
    allowed = EXPLAINED * min(error(given), 1.0)
    return next((mistake for mistake, matrix in repairs if error(matrix) <= allowed), "")


def repaired_weights(weights: np.ndarray, exact: np.ndarray, functions: Basis) -> Iterator[Repair]:
    """Orders in which people write the products z_i z_j, factors that they forget; weights: (M,), exact: (n, n)."""
    row, column = np.triu_indices(functions.states)
    given, known = (each[: functions.quadratic_size] for each in (weights, functions.weights(exact)))
    orders = {
        "": np.arange(len(given)),
        "stand column by column": np.lexsort((row, column)),
        "stand with the squares first": np.argsort(row != column, kind="stable"),
    }
    twice = np.where(row == column, 1.0, 2.0)
    lacking = {"": np.ones(len(given)), "lack the factor 2 of products z_i z_j": twice}
    costs = {"": 1.0, "are of half the cost": 2.0, "are of twice the cost": 0.5}
    # One mistake before two, two before three; half the cost alone is said of the value.
    ways = sorted(itertools.product(orders, lacking, costs), key=lambda way: sum(map(bool, way)))
    for order, factor, cost in ways:
        if order or factor:
            placed = np.empty_like(given)
            placed[orders[order]] = given
            said = " and ".join(filter(None, (order, factor, cost)))
            right = "they must go row by row, i <= j" if order else "they are 2 P_ij"
            yield f"the weights {said}; {right}", functions.matrix(costs[cost] * lacking[factor] * placed)
    wrong = np.sort(np.argsort(np.abs(given - known), kind="stable")[-2:])
    if len(given) > 1:
        swapped = given.copy()
        swapped[wrong] = given[wrong[::-1]]
        yield f"weights {wrong[0] + 1} and {wrong[1] + 1} are interchanged", functions.matrix(swapped)


def repaired_value(P: np.ndarray, exact: np.ndarray, units: np.ndarray) -> Iterator[Repair]:
    """P, exact: (n, n) symmetric; units: balanced ones, in which the largest error is looked for."""
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
    for said, units_of in _other_units("state", "row and column", "P", factors, np.triu(exact)):
        yield said, P / np.outer(units_of, units_of)
    yield from _one_entry("P", P, exact, np.outer(units, units))


def repaired_gain(game: Game, K: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """K, exact: (m, n)."""
    m, n = K.shape
    yield "the gain has the wrong sign: the policy is u = -K z", -K
    yield "the gain is half the exact one", 2.0 * K
    yield "the gain is twice the exact one", K / 2.0
    if m == n:
        yield "K is transposed", K.T
    yield "R⁻¹ is missing: this is B'P, and K is R⁻¹B'P", np.linalg.solve(game.R, K)
    yield from _one_factor("K", K, exact, int(np.count_nonzero(exact)))
    yield "K was read row by row, its entries stand column by column", K.reshape(n, m).T
    for kind, axis in (("input", 1), ("state", 0)):
        order = _order(np.linalg.norm(K, axis=axis), np.linalg.norm(exact, axis=axis))
        placed = _placed(K, order) if axis else _placed(K.T, order).T
        yield f"the {kind}s are in the order {_listed(order)}", placed
        flipped = np.sum(K * exact, axis=axis) < 0.0
        if flipped.any():
            verb = "has" if flipped.sum() == 1 else "have"
            said = _named(kind, flipped).rpartition(" ")[0]
            yield f"{said} {verb} the wrong sign", K * np.expand_dims(np.where(flipped, -1.0, 1.0), axis)
    for kind, line, axis in (("input", "row", 1), ("state", "column", 0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            factors = np.sum(K * exact, axis=axis) / np.sum(exact * exact, axis=axis)
        for said, units in _other_units(kind, line, "K", factors, exact):
            yield said, K / np.expand_dims(units, axis)
    yield from _one_entry("K", K, exact, np.sqrt(np.diag(game.R))[:, None] * balanced_units(game))


def _one_factor(name: str, matrix: np.ndarray, exact: np.ndarray, known: int) -> Iterator[Repair]:
    """The factor that least squares give, where enough of the known numbers test it."""
    factor = float(np.sum(matrix * exact) / (np.sum(exact * exact) or 1.0))
    power = _decades(factor)
    if power or (known >= 1 + REDUNDANT and math.isfinite(factor) and factor != 0.0):
        factor = 10.0**power if power else factor
        yield f"every entry of {name} is {factor:.6g} times the exact one", matrix / factor


def _other_units(
    kind: str, line: str, name: str, factors: np.ndarray, exact: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """Degrees in place of radians, or any other units, of some states or inputs: the mistake, and the factors (n,).

    factors: of each state or input, as they look; nothing where the numbers that would test them are too few.
    """
    degree = 1.0 / _DEGREES if line != "row" else _DEGREES
    angles = np.abs(np.log(np.abs(np.where(factors == 0.0, np.nan, factors)) / degree)) < 0.1
    if angles.any() and not angles.all():
        yield f"{_named(kind, angles)} in degrees", np.where(angles, degree, 1.0)
    other = np.flatnonzero(np.abs(factors - 1.0) > _NEAR)
    enough = np.count_nonzero(exact) >= len(factors) + REDUNDANT
    if enough and len(other) and np.all(np.isfinite(factors) & (factors != 0.0)):
        places, values = _and([str(place + 1) for place in other]), _and([f"{each:.4g}" for each in factors[other]])
        plural = "s" if len(other) > 1 else ""
        verb = "are" if plural or " and " in line else "is"
        lines = line.replace(" and ", f"{plural} and ") + plural
        yield f"{lines} {places} of {name} {verb} {values} times the exact (other units?)", factors


def _one_entry(name: str, matrix: np.ndarray, exact: np.ndarray, scales: np.ndarray) -> Iterator[Repair]:
    """The entry that is farthest off, with its mirror image if the matrix is symmetric: a sign, a decimal slip."""
    i, j = np.unravel_index(int(np.argmax(np.abs(matrix - exact) * scales)), matrix.shape)
    ratio = float(matrix[i, j] / exact[i, j]) if exact[i, j] else math.nan
    factor = -1.0 if ratio < 0.0 else 10.0 ** _decades(ratio)
    if factor != 1.0:
        repaired = matrix.copy()
        for place in {(i, j), (j, i)} if name == "P" else {(i, j)}:
            repaired[place] = matrix[place] / factor
        slip = f"is {factor:g} times the exact one: a decimal slip"
        yield f"{name}({i + 1}, {j + 1}) {'has the wrong sign' if factor < 0.0 else slip}", repaired


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


def _decades(ratio: float) -> int:
    """k with ratio = 10^k, 0 when there is none."""
    if not (math.isfinite(ratio) and ratio > 0.0):
        return 0
    power = math.log10(ratio)
    return round(power) if abs(power - round(power)) < _NEAR else 0


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
    return f"{kind} {places[0]} is" if len(places) == 1 else f"{kind}s {_and(places)} are"


def _and(words: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
