"""Hypotheses about common mistakes in critics.

A hypothesis consists of a sentence and the critic's matrix with the mistake reversed. Whether a
hypothesis is reported depends only on the comparison with the exact solution (`diagnosis`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from controller.game.basis import Basis
from controller.game.zero_sum import Game
from verification.critic_errors import relative_error

#: Least number of values in addition to the fitted numbers. Fewer values would agree by chance.
REDUNDANT = 2
#: Relative distance from the exact value times a power of ten at which an entry may have a wrong
#: decimal point.
_NEAR = 0.05
#: A smaller entry, relative to the largest, is replaced by this fraction in comparisons.
_SMALL = 1e-5
#: An entry above this fraction of its typical size is informative (`View.entry_errors`).
_TOLD = 0.1
#: Factor on a slope per degree, and on the column of a state in degrees.
DEGREE = math.pi / 180.0
#: A scale within this logarithmic distance from the factor of degrees is taken as degrees.
_DEGREE_BAND = 1.5
#: Number of rounds in which scales are fitted to the states of a symmetric matrix.
_ROUNDS = 5
_FACTORS = {"has the wrong sign": -1.0, "is half the exact one": 2.0, "is twice the exact one": 0.5}


class Hypothesis(NamedTuple):
    """Mistake that a critic may have.

    says: sentence that names the mistake.
    undo: P (n, n) or K (m, n) of the critic with the mistake reversed.
    fitted: numbers fitted to the critic: "" for none, "factor" for one number, "scales" for one
        number for each state or input.
    answer: exact P or K of another game, or None if the mistake is not another game.
    """

    says: str
    undo: np.ndarray
    fitted: str = ""
    answer: np.ndarray | None = None


class View(NamedTuple):
    """Matrix of a critic, the exact matrix, and the measure of the error.

    kind: "P" or "K".
    judged: matrix of the critic, (k, n).
    exact: exact matrix, (k, n).
    weights: weights of the entries in the norm of an error, (k, n).
    units: units in which the states contribute about equally to the value, 1 / √P_ii, (n,).
    """

    kind: str
    judged: np.ndarray
    exact: np.ndarray
    weights: np.ndarray
    units: np.ndarray

    @property
    def noun(self) -> str:
        """Noun for the matrix in sentences: "solution" for P, "gain" for K."""
        return "solution" if self.kind == "P" else "gain"

    @property
    def known(self) -> int:
        """Number of independent nonzero entries of the exact matrix.

        Mirrored entries of P count once.
        """
        return int(np.count_nonzero(np.triu(self.exact) if self.kind == "P" else self.exact))

    def entry_errors(self, hypothesis: Hypothesis) -> np.ndarray:
        """Return the error of each informative entry under a hypothesis, (entries,).

        - Another game: the critic's matrix is compared with the matrix of this game.
        - Other mistakes: the matrix with the mistake reversed is compared with the exact matrix.

        The errors are in units in which the entries are comparable. Entries that are small in both
        matrices are omitted.
        """
        tested = hypothesis.undo
        right = self.exact
        if hypothesis.answer is not None:
            tested = self.judged
            right = hypothesis.answer
        if self.kind == "P":
            diagonal = np.sqrt(np.abs(np.diag(right)))
            least = _SMALL * np.max(diagonal * self.units) / self.units
            diagonal = np.maximum(diagonal, least)
            sizes = np.outer(diagonal, diagonal)
        else:
            rows = np.linalg.norm(right * self.units, axis=1, keepdims=True)
            sizes = np.maximum(rows, _SMALL * rows.max()) / self.units
        with np.errstate(all="ignore"):
            errors = np.abs(tested - right) / sizes
            told = np.maximum(np.abs(tested), np.abs(right)) / sizes > _TOLD
        return np.asarray(np.where(np.isnan(errors), np.inf, errors)[told])

    def relative(self) -> View:
        """Return the view with weights such that errors are relative to each exact entry.

        Entries smaller than `_SMALL` times the largest entry are measured relative to this size.
        """
        sizes = np.abs(self.exact * self.weights)
        least = _SMALL * sizes.max() or 1.0
        return self._replace(weights=self.weights / np.maximum(sizes, least))

    def transposed(self) -> View:
        """Return the view with the matrices `judged`, `exact` and `weights` transposed."""
        return self._replace(judged=self.judged.T, exact=self.exact.T, weights=self.weights.T)


class Demands(NamedTuple):
    """Thresholds for naming a mistake.

    left: permitted remaining part of the error for each kind of `Hypothesis.fitted`. The part is
        smaller if numbers were fitted, because fitted numbers explain part of any error.
    least: largest error of a critic for which the permitted part of `EXACT` applies instead.
    entry: largest permitted error of an entry under the hypothesis (`View.entry_errors`).
    share: fraction of the informative entries that must satisfy `entry`.
    """

    left: Mapping[str, float]
    least: float = 0.0
    entry: float = 0.01
    share: float = 1.0


EXACT = Demands({"": 1e-3, "factor": 1e-3, "scales": 1e-4})
WITH_NOISE = Demands({"": 0.15, "factor": 0.01, "scales": 1e-4}, 0.03, 0.5)
OF_NETWORKS = Demands({"": 0.15, "factor": 0.01, "scales": 0.03}, 0.03, 0.3, 0.6)


def error_of(view: View, matrix: np.ndarray) -> float:
    """Return |matrix - exact| / |exact|, the relative error of a matrix in weighted norms.

    view: the exact matrix and the weights of the Frobenius norms
    """
    return relative_error(matrix * view.weights, view.exact * view.weights)


def of_weights(weights: np.ndarray, exact: np.ndarray, psi: Basis) -> Iterator[Hypothesis]:
    """Yield hypotheses of mistakes in the weights of a critic.

    - Weights in another order, without the factor 2 of products, or of half the cost, or several of
      these mistakes. Half the cost alone is omitted.
    - The two weights with the largest errors interchanged.

    weights: weights of the critic, (M,)
    exact: exact matrix P, (n, n)
    psi: basis of the weights
    """
    row, column = np.triu_indices(psi.states)
    quadratic = weights[: psi.quadratic_size]
    orders = {
        "": np.arange(len(quadratic)),
        "are stored with the squares first": np.argsort(row != column, kind="stable"),
    }
    if psi.states > 2:  # for two states, both orders are equal
        orders["are stored column by column"] = np.lexsort((row, column))
    factors = {
        "": np.ones(len(quadratic)),
        "lack the factor 2 of products z_i z_j": np.where(row == column, 1.0, 2.0),
    }
    costs = {"": 1.0, "are of half the cost": 2.0}
    for order, factor, cost in itertools.product(orders, factors, costs):
        mistakes = [mistake for mistake in (order, factor, cost) if mistake]
        if mistakes and mistakes != ["are of half the cost"]:
            placed = np.empty_like(quadratic)
            placed[orders[order]] = quadratic
            right = costs[cost] * factors[factor] * placed
            says = f"the weights {' and '.join(mistakes)}"
            if order:
                says += "; the order must be row by row, i <= j"
            yield Hypothesis(says, psi.matrix(right))
    if len(quadratic) > 1:
        exact_weights = psi.weights(exact)[: psi.quadratic_size]
        distances = np.abs(quadratic - exact_weights)
        first, second = np.sort(np.argsort(distances, kind="stable")[-2:])
        swapped = quadratic.copy()
        swapped[[first, second]] = quadratic[[second, first]]
        says = f"weights {first + 1} and {second + 1} are interchanged"
        yield Hypothesis(says, psi.matrix(swapped))


def of_matrix(game: Game, view: View) -> Iterator[Hypothesis]:
    """Yield hypotheses of mistakes in a matrix P or K.

    - Both: sign, factor, order, units of states or inputs, one wrong entry.
    - P: a missing triangle, off-diagonal entries that are twice too large.
    - K: transposed, a missing R⁻¹, entries stored column by column.
    """
    if view.kind == "P":
        says = "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
        for half in (np.triu(view.judged), np.tril(view.judged)):
            yield Hypothesis(says, half + half.T - np.diag(np.diag(half)))
        view = view._replace(judged=(view.judged + view.judged.T) / 2.0)
        yield from _factors(view, "value", "V is z'Pz, without a factor 1/2")
        beside = np.where(np.eye(len(view.judged), dtype=bool), 1.0, 0.5)
        says = "the entries of P off the diagonal are twice too large: they must be W / 2"
        yield Hypothesis(says, view.judged * beside)
        yield from of_sides(view)
    else:
        K = view.judged
        yield from _factors(view, "gain", "the policy is u = -K z")
        if K.shape[0] == K.shape[1]:
            yield Hypothesis("K is transposed", K.T)
        says = "R⁻¹ is missing: this is B'P, and K is R⁻¹B'P"
        yield Hypothesis(says, np.linalg.solve(game.R, K))
        says = "K was read row by row, but its entries are stored column by column"
        yield Hypothesis(says, K.reshape(K.shape[::-1]).T)
        yield from of_rows(view, "input", 1.0 / DEGREE)
        yield from of_columns(view, "state", DEGREE)
    yield from _one_entry(view)


def _factors(view: View, noun: str, meant: str) -> Iterator[Hypothesis]:
    """Yield hypotheses that all entries of a matrix are multiplied by one factor."""
    for mistake, factor in _FACTORS.items():
        yield Hypothesis(f"the {noun} {mistake}: {meant}", factor * view.judged)
    weights = view.weights**2
    size = float(np.sum(view.exact**2 * weights)) or 1.0
    factor = float(np.sum(view.judged * view.exact * weights)) / size
    power = _nearest_power_of_ten(factor)
    if power:
        says = f"every entry of {view.kind} is {10.0**power:g} times the exact one"
        yield Hypothesis(says, view.judged / 10.0**power)
    if math.isfinite(factor) and factor != 0.0 and view.known >= 1 + REDUNDANT:
        says = f"every entry of {view.kind} is {factor:.6g} times the exact one"
        yield Hypothesis(says, view.judged / factor, "factor")


def _nearest_power_of_ten(ratio: float) -> int:
    """Return k with 10^k nearest to a ratio, or 0 if the ratio is not positive and finite."""
    if not (math.isfinite(ratio) and ratio > 0.0):
        return 0
    return round(math.log10(ratio))


def _one_entry(view: View) -> Iterator[Hypothesis]:
    """Yield the hypothesis of a wrong sign or decimal point in the entry with the largest error."""
    # In P, the mirrored entry is corrected too. Nothing is yielded unless the critic's entry is
    # about ± a power of ten times the exact entry.
    if view.known < 1 + REDUNDANT:
        return
    errors = np.abs(view.judged - view.exact) * view.weights
    row, column = np.unravel_index(int(np.argmax(errors)), errors.shape)
    exact = view.exact[row, column]
    if exact == 0.0:
        return
    ratio = float(view.judged[row, column] / exact)
    name = f"{view.kind}({row + 1}, {column + 1})"
    power = _nearest_power_of_ten(abs(ratio))
    factor = math.copysign(10.0**power, ratio)
    if factor == 1.0 or not abs(ratio / factor - 1.0) < _NEAR:
        return
    if factor == -1.0:
        says = f"{name} has the wrong sign"
    else:
        says = f"{name} is {factor:g} times the exact one: a decimal slip"
    undo = view.judged.copy()
    undo[row, column] /= factor
    if view.kind == "P" and row != column:
        undo[column, row] /= factor
    yield Hypothesis(says, undo)


def of_rows(view: View, noun: str, degree: float) -> Iterator[Hypothesis]:
    """Yield hypotheses of mistakes in the rows of a matrix: order, signs, degrees and scales.

    noun: noun for the quantity of a row: "input", "slope" or "state"
    degree: factor of a row whose quantity is in degrees
    """
    size = len(view.judged)
    with np.errstate(all="ignore"):
        away = np.sum(((view.judged[:, None] - view.exact) * view.weights) ** 2, axis=-1)
        weights = view.weights**2
        factors = np.sum(view.judged * view.exact * weights, axis=1)
        factors /= np.sum(view.exact**2 * weights, axis=1)
    order = _best_order(away)
    yield Hypothesis(_order_text(noun, order), np.eye(size)[order].T @ view.judged)
    for says, divisors, fitted in _scales(view, noun, factors, degree):
        yield Hypothesis(says, view.judged / divisors[:, None], fitted)


def of_columns(view: View, noun: str, degree: float) -> Iterator[Hypothesis]:
    """Yield hypotheses of mistakes in the columns of a matrix: order, signs, degrees and scales.

    noun: noun for the quantity of a column
    degree: factor of a column whose quantity is in degrees
    """
    for mistake in of_rows(view.transposed(), noun, degree):
        yield mistake._replace(undo=mistake.undo.T)


def of_sides(view: View) -> Iterator[Hypothesis]:
    """Yield hypotheses of mistakes of the states in a symmetric matrix.

    The mistakes are order, signs, degrees and scales.
    """
    noun = "state"
    size = len(view.judged)
    with np.errstate(all="ignore"):
        rows = np.sort(view.judged)[:, None]
        exact_rows = np.sort(view.exact)[None]
        apart = np.abs(rows - exact_rows) / (np.abs(rows) + np.abs(exact_rows))
        factors = _symmetric_factors(view)
    order = _best_order(np.sum(np.nan_to_num(apart), axis=-1))
    back = np.eye(size)[order].T
    yield Hypothesis(_order_text(noun, order), back @ view.judged @ back.T)
    for says, divisors, fitted in _scales(view, noun, factors, DEGREE):
        yield Hypothesis(says, view.judged / np.outer(divisors, divisors), fitted)


def _symmetric_factors(view: View) -> np.ndarray:
    """Return factors t (n,) of the states such that t_i t_j exact_ij approximates judged_ij."""
    P = view.exact
    signs = np.sign(view.judged * P)[int(np.argmax(np.diag(P)))]
    factors = np.sqrt(np.abs(np.diag(view.judged) / np.diag(P)))
    factors = np.where(signs < 0.0, -factors, factors)
    if 2 * np.count_nonzero(factors < 0.0) > len(factors):
        factors = -factors
    for _ in range(_ROUNDS):
        for index in range(len(factors)):
            line = P[index] * factors
            weighted = line * view.weights[index] ** 2
            factors[index] = view.judged[index] @ weighted / (line @ weighted)
    return factors


def _scales(
    view: View, noun: str, factors: np.ndarray, degree: float
) -> Iterator[tuple[str, np.ndarray, str]]:
    """Yield mistakes that the factors of states or inputs suggest: signs, degrees and scales."""
    flipped = factors < 0.0
    with np.errstate(all="ignore"):
        angles = np.abs(np.log(np.abs(factors) / degree)) < _DEGREE_BAND
    if flipped.any() and not flipped.all():
        verb = "has the wrong sign" if flipped.sum() == 1 else "have the wrong sign"
        yield f"{_listed(noun, flipped)} {verb}", np.where(flipped, -1.0, 1.0), ""
    if angles.any() and not angles.all():
        verb = "is in degrees" if angles.sum() == 1 else "are in degrees"
        yield f"{_listed(noun, angles)} {verb}", np.where(angles, degree, 1.0), ""
    are_scales = bool(np.all(np.isfinite(factors) & (factors > 0.0)))
    if are_scales and view.known >= len(factors) + REDUNDANT:
        values = ", ".join(f"{factor:.3g}" for factor in factors)
        yield f"the {noun}s look scaled by {values}", factors, "scales"


def _listed(noun: str, where: np.ndarray) -> str:
    """Return the indices in a mask as text, such as "state 2" or "states 2, 3 and 5"."""
    *numbers, last = (str(index + 1) for index in np.flatnonzero(where))
    return f"{noun}s {', '.join(numbers)} and {last}" if numbers else f"{noun} {last}"


def _order_text(noun: str, order: Sequence[int] | np.ndarray) -> str:
    return f"the {noun}s are in the order {', '.join(str(index + 1) for index in order)}"


def _best_order(away: np.ndarray) -> np.ndarray:
    """Return the permutation (n,) for which the sum of away[i, order[i]] is smallest."""
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(np.nan_to_num(away, nan=1e300, posinf=1e300))[1])
