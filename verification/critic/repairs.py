"""What a critic would be without one of the mistakes that people make: the mistake in words, and the repaired matrix.

Each repair is a guess from the critic's own numbers; only the comparison with the exact answer makes it a cause.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from controller.game.basis import Basis

#: Degrees in a radian.
DEGREES = 180.0 / math.pi
#: A ratio this near to a power of ten, in decades, is a decimal slip.
_NEAR = 1e-3


#: Numbers of a critic beyond those that are solved for; one alone would fit by chance.
REDUNDANT = 2


class Repair(NamedTuple):
    """What the mistake is, and P (n, n) or K (m, n) without it."""

    mistake: str
    matrix: np.ndarray


def repaired_weights(weights: np.ndarray, exact: np.ndarray, functions: Basis) -> Iterator[Repair]:
    """Orders in which people write the products z_i z_j; weights, exact: (M,)."""
    n, size = functions.states, functions.quadratic_size
    row, column = np.triu_indices(n)
    given = weights[:size]
    factor = np.where(row == column, 1.0, 2.0)
    orders = {
        "stand column by column": np.lexsort((row, column)),
        "stand with the squares first": np.argsort(row != column, kind="stable"),
    }
    placed = {name: np.empty(size) for name in orders} | {"": given}
    for name, order in orders.items():
        placed[name][order] = given
        yield Repair(f"the weights {name}; they must go row by row, i <= j", functions.matrix(placed[name]))
    wrong = np.argsort(np.abs(given - exact[:size]), kind="stable")[-2:]
    if size > 1:
        swapped = given.copy()
        swapped[wrong] = given[wrong[::-1]]
        first, second = sorted(int(place) + 1 for place in wrong)
        yield Repair(f"weights {first} and {second} are interchanged", functions.matrix(swapped))
    yield Repair(
        "the weights of products z_i z_j lack their factor 2: they are 2 P_ij", functions.matrix(factor * given)
    )
    costs = {"": 1.0, "are of half the cost": 2.0, "are of twice the cost": 0.5}
    for name, lacking, cost in itertools.product(placed, ("", "lack the factor 2 of products z_i z_j"), costs):
        said = [each for each in (name, lacking, cost) if each]
        if len(said) > 1:
            weights_right = costs[cost] * (factor * placed[name] if lacking else placed[name])
            yield Repair(f"the weights {_and(said)}", functions.matrix(weights_right))


def repaired_value(P: np.ndarray, exact: np.ndarray, units: np.ndarray) -> Iterator[Repair]:
    """P, exact: (n, n) symmetric; units: balanced ones, in which the largest error is looked for."""
    n = len(P)
    yield Repair("the value has the wrong sign", -P)
    yield Repair("the value is half the exact one: V here is z'Pz of the cost without a factor 1/2", 2.0 * P)
    yield Repair("the value is twice the exact one: V here is z'Pz of the cost without a factor 2", P / 2.0)
    if power := _decades(_factor(P, exact)):
        yield Repair(f"every entry is {10.0**power:g} times the exact one", P / 10.0**power)
    beside = np.where(np.eye(n, dtype=bool), 1.0, 0.5)
    yield Repair("P has entries beside the diagonal of twice their size: they are W / 2", P * beside)
    order = _order(np.diag(P), np.diag(exact))
    yield Repair(f"the states are in the order {_listed(order)}", _placed(_placed(P, order).T, order).T)
    yield from _rescaled(P, exact)
    yield from _one_entry("P", P, exact, np.outer(units, units))


def repaired_gain(K: np.ndarray, exact: np.ndarray, R: np.ndarray, scales: np.ndarray) -> Iterator[Repair]:
    """K, exact: (m, n); R: (m, m); scales: what makes the entries comparable, (m, n)."""
    m, n = K.shape
    yield Repair("the gain has the wrong sign: the policy is u = -K z", -K)
    yield Repair("the gain is half the exact one", 2.0 * K)
    yield Repair("the gain is twice the exact one", K / 2.0)
    if power := _decades(_factor(K, exact)):
        yield Repair(f"every entry is {10.0**power:g} times the exact one", K / 10.0**power)
    if m == n:
        yield Repair("K is transposed", K.T)
    order = _order(np.linalg.norm(K, axis=1), np.linalg.norm(exact, axis=1))
    yield Repair(f"the inputs are in the order {_listed(order)}", _placed(K, order))
    order = _order(np.linalg.norm(K, axis=0), np.linalg.norm(exact, axis=0))
    yield Repair(f"the states are in the order {_listed(order)}", _placed(K.T, order).T)
    for i in range(m):
        sign = np.where(np.arange(m) == i, -1.0, 1.0)
        yield Repair(f"input {i + 1} has the wrong sign", sign[:, None] * K)
    for j in range(n):
        sign = np.where(np.arange(n) == j, -1.0, 1.0)
        yield Repair(f"state {j + 1} has the wrong sign", K * sign)
    yield from _per_degree(K, exact)
    missing = ~K.any(axis=0) & exact.any(axis=0)
    if missing.any() and np.count_nonzero(K) >= 1 + REDUNDANT:
        columns = ", ".join(str(place + 1) for place in np.flatnonzero(missing))
        yield Repair(
            f"the feedback of states {columns} is missing: their columns of K are 0", np.where(missing, exact, K)
        )
    yield Repair("R⁻¹ is missing: this is B'P, and K is R⁻¹B'P", np.linalg.solve(R, K))
    yield from _one_entry("K", K, exact, scales)


def _factor(matrix: np.ndarray, exact: np.ndarray) -> float:
    """What least squares say that the matrix is of the exact one."""
    return float(np.sum(matrix * exact) / (np.sum(exact * exact) or 1.0))


def _rescaled(P: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """States in degrees, P_ij t_i t_j with t = pi/180; states of the other sign, t = -1."""
    ratios = np.sqrt(np.abs(np.diag(P) / np.where(np.diag(exact) == 0.0, np.inf, np.diag(exact))))
    angles = np.abs(np.log(np.maximum(ratios, np.finfo(float).tiny)) + math.log(DEGREES)) < 0.1
    units = np.where(angles, DEGREES, 1.0)
    if angles.any() and not angles.all():
        yield Repair(f"{_named('state', angles)} in degrees", P * np.outer(units, units))
    row = int(np.argmax(np.diag(exact)))
    flipped = P[row] * exact[row] < 0.0
    flipped = ~flipped if 2 * flipped.sum() > len(flipped) else flipped
    signs = np.where(flipped, -1.0, 1.0)
    if flipped.any():
        yield Repair(f"{_named('state', flipped)} of the other sign", P * np.outer(signs, signs))


def _per_degree(K: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """K_ij 180/π for input i in degrees, K_ij π/180 for state j in degrees."""
    known = (exact != 0.0) & (K != 0.0)
    ratios = np.where(known, K / np.where(known, exact, 1.0), 1.0)
    powers = np.rint(np.log(np.abs(ratios)) / math.log(DEGREES)).astype(int)
    found = []
    for shift in (-1, 0, 1):
        of_states = -(powers[0] - shift)
        of_inputs = np.rint(np.median(powers + of_states, axis=1)).astype(int)
        if min(of_inputs.min(), of_states.min()) >= 0 and max(of_inputs.max(), of_states.max()) <= 1:
            found.append((int(of_inputs.sum() + of_states.sum()), of_inputs, of_states))
    if found:
        count, of_inputs, of_states = min(found, key=lambda each: each[0])
        if count:
            kinds = (("input", of_inputs), ("state", of_states))
            said = " and ".join(_named(kind, where > 0) for kind, where in kinds if where.any())
            yield Repair(f"{said} in degrees", K / DEGREES ** (of_inputs[:, None] - of_states))


def rescaled(name: str, matrix: np.ndarray, exact: np.ndarray) -> Iterator[Repair]:
    """P / f, P_ij / (f_i f_j), K / f, K_ij / f_i, K_ij / f_j: a critic in other units, if nothing else is wrong.

    name: P or K, of matrix and exact. Nothing where the factors are as many as the numbers that would test them.
    """
    known = np.count_nonzero(np.triu(exact) if name == "P" else exact)
    factor = _factor(matrix, exact)
    if known >= 1 + REDUNDANT and math.isfinite(factor) and factor != 0.0:
        yield Repair(f"every entry is {factor:.6g} times the exact one", matrix / factor)
    ways: list[tuple[str, np.ndarray, np.ndarray]] = []
    with np.errstate(divide="ignore", invalid="ignore"):
        if name == "P":
            factors = np.sqrt(np.diag(matrix) / np.diag(exact))
            ways.append(("row and column", factors, np.outer(factors, factors)))
        else:
            for line, axis in (("row", 1), ("column", 0)):
                factors = np.sum(matrix * exact, axis=axis) / np.sum(exact * exact, axis=axis)
                ways.append((line, factors, np.expand_dims(factors, axis)))
    for line, factors, divisor in ways:
        other = np.flatnonzero(np.abs(factors - 1.0) > _NEAR)
        if known < len(factors) + REDUNDANT or not len(other) or not np.all(np.isfinite(factors) & (factors != 0.0)):
            continue
        places, values = _and([*map(str, other + 1)]), _and([f"{factor:.4g}" for factor in factors[other]])
        plural = "s" if len(other) > 1 else ""
        said = line.replace(" and ", f"{plural} and ") + plural
        verb = "are" if plural or " and " in line else "is"
        yield Repair(f"{said} {places} of {name} {verb} {values} times the exact (other units?)", matrix / divisor)


def _one_entry(name: str, matrix: np.ndarray, exact: np.ndarray, scales: np.ndarray) -> Iterator[Repair]:
    """The entry that is farthest off, with its mirror image if the matrix is symmetric: a sign, a decimal slip."""
    i, j = np.unravel_index(int(np.argmax(np.abs(matrix - exact) * scales)), matrix.shape)
    if exact[i, j] == 0.0:
        return
    ratio = float(matrix[i, j] / exact[i, j])
    repaired = matrix.copy()
    places = [(i, j), (j, i)] if name == "P" else [(i, j)]
    for place in places:
        repaired[place] = -matrix[place]
    if ratio < 0.0:
        yield Repair(f"{name}({i + 1}, {j + 1}) has the wrong sign", repaired)
    power = _decades(ratio)
    if power:
        for place in places:
            repaired[place] = matrix[place] / 10.0**power
        yield Repair(f"{name}({i + 1}, {j + 1}) is {10.0**power:g} times the exact one: a decimal slip", repaired)


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
    if len(places) == 1:
        return f"{kind} {places[0]} is"
    return f"{kind}s {_and(places)} are"


def _and(words: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
