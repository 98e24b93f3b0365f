"""Search for the mistake in a wrong critic, by a table of exact transformations.

A mistake is named only if the critic without it passes the checks of P, K or H, and the exact one
with it does not. Nothing else is decided by a tolerance.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from controller.critic.critic import Critic
from controller.critic.features import blocks_in_order
from controller.game.basis import Basis, q_extremum
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_support.reporting.text import numbered, percent
from verification.box import balanced_units
from verification.critic_errors import (
    SMALL,
    action_value_error,
    exact_action_value,
    floored,
    matrix_errors,
    measure_of,
    relative_error,
)
from verification.other_games import other_games

#: A factor within this relative distance from its nominal value is tried as that of a mistake.
NEAR = 0.05
#: Factor on a slope per degree, and on the column of a state in degrees.
DEGREE = math.pi / 180.0
_AS_ANGLES = "as degrees and radians are"
#: Units other than the plant's -> factor on the column of a state in K.
UNITS_OF_STATES = {
    "in degrees": DEGREE,
    "in metres in place of feet": 1.0 / 0.3048,
    "in feet in place of metres": 0.3048,
    f"off by 180/pi, {_AS_ANGLES}": 1.0 / DEGREE,
}
#: Units other than the plant's -> factor on the row of an input in K.
UNITS_OF_INPUTS = {"in degrees": 1.0 / DEGREE, f"off by pi/180, {_AS_ANGLES}": DEGREE}
#: Factors of all entries, and their names.
FACTORS = {-1.0: "has the wrong sign", 0.5: "is half the exact one", 2.0: "is twice the exact one"}


class Mistake(NamedTuple):
    """Mistake that a matrix of a critic may have.

    says: sentence that names the mistake
    undone: the matrix without the mistake
    """

    says: str
    undone: np.ndarray


class Compared(NamedTuple):
    """A matrix of a critic compared with the exact one.

    kind: "P", "K" or "H"
    given, exact: the matrices
    sizes: sizes of the entries, which change with the units as the entries do
    is_right: whether a matrix passes the checks of its errors
    """

    kind: str
    given: np.ndarray
    exact: np.ndarray
    sizes: np.ndarray
    is_right: Callable[[np.ndarray], bool]

    @classmethod
    def of(
        cls, kind: str, given: np.ndarray, exact: Solution, sizes: Any, limit: float
    ) -> Compared:
        """Return P or K compared with the exact one.

        kind, given, sizes: as the fields
        exact: solution of the game
        limit: largest error of a right matrix
        """
        measure = measure_of(kind, exact)
        return cls(kind, given, measure.exact, sizes, lambda M: max(measure.errors(M)) <= limit)

    def first(self, mistakes: Iterator[Mistake]) -> str:
        """Return the sentence of the first mistake that explains the errors, or "".

        The matrix is right without the mistake, and the exact one would be wrong with it.
        """
        for mistake in mistakes:
            with_mistake = self.exact + (self.given - mistake.undone)
            if self.is_right(mistake.undone) and not self.is_right(with_mistake):
                return mistake.says
        return ""

    def errors(self, matrix: np.ndarray) -> np.ndarray:
        """Return the relative error of each entry of a matrix."""
        return np.abs(matrix - self.exact) / self.sizes


def reason_for(exact: Solution, critic: Critic, limit: float) -> str:
    """Return a sentence that names the mistake in a wrong critic, or "" if none is recognized.

    exact: solution of the game
    limit: largest relative error of a right critic
    """
    game = exact.game
    if critic.H is not None:
        exact_H = exact_action_value(critic, exact)
        if exact_H is not None and action_value_error(critic.H, exact_H) > limit:
            return _reason_for_action_value(game, critic.H, exact_H, limit)
        implied = q_extremum(game, critic.H)
        if all(np.array_equal(getattr(critic, name), implied[name]) for name in "PK"):
            return ""  # P and K follow from H: nothing else can be wrong
    if critic.P is None:
        return _reason_for_gain(exact, critic.K, limit)
    if all(check.ok for check in matrix_errors("P", critic.P, exact, limit)):
        return _reason_for_policy(exact, critic, critic.P, limit)
    sizes = _sizes_of_states(exact)
    values = Compared.of("P", critic.P, exact, np.outer(sizes, sizes), limit)
    mistakes = itertools.chain(
        _of_weights(critic), _of_value(game, values), _of_other_games(exact, values)
    )
    return values.first(mistakes) or _gain_against_implied(exact, critic, critic.P, limit)


def _reason_for_gain(exact: Solution, K: np.ndarray, limit: float) -> str:
    """Return a sentence that names the mistake in a wrong K, or ""."""
    gains = _gains(exact, K, limit)
    return gains.first(itertools.chain(_of_gain(exact, gains), _of_other_games(exact, gains)))


def _reason_for_policy(exact: Solution, critic: Critic, P: np.ndarray, limit: float) -> str:
    """Return a sentence on the wrong policy of a critic with a right P, or ""."""
    if critic.slope_gain is not None and critic.is_quadratic:  # K is R⁻¹B'P of this P
        error = max(measure_of("K", exact).errors(critic.K))
        return (
            "P is right within the limit; the K that follows from it is off by"
            f" {error:.2g}: it needs more digits of P"
        )
    return (
        _beyond_quadratic(critic)
        or _reason_for_gain(exact, critic.K, limit)
        or _gain_against_implied(exact, critic, P, limit)
    )


def _reason_for_action_value(game: Game, H: np.ndarray, exact_H: np.ndarray, limit: float) -> str:
    """Return a sentence that names the mistake in the matrix H of an action value, or "".

    exact_H: the exact H of the same signals
    """
    sizes = floored(np.sqrt(np.abs(np.diag(exact_H))))
    values = Compared(
        kind="H",
        given=H,
        exact=exact_H,
        sizes=np.outer(sizes, sizes),
        is_right=lambda M: action_value_error(M, exact_H) <= limit,
    )
    n, m = game.B.shape
    blocks = {"x": numbered("x", n), "u": numbered("u", m), "w": numbered("w", len(H) - n - m)}
    present = [block for block, signals in blocks.items() if signals]

    def mistakes() -> Iterator[Mistake]:
        # The right order is among them. It leaves H, which is wrong, so that it explains nothing.
        for order in itertools.permutations(present):
            texts = [", ".join(names) for names in (order, present)]
            says = f"H is in the order ({texts[0]}); it must be in the order ({texts[1]})"
            places = blocks_in_order(order, blocks)
            yield Mistake(says, H[np.ix_(places, places)])
        says = "the action value has the wrong sign: it is of rewards; Q is of costs"
        yield Mistake(says, -H)
        yield from _factors("action value", "Q is [x; u; w]'H [x; u; w], without 1/2", values)

    return values.first(mistakes())


def _of_other_games(exact: Solution, compared: Compared) -> Iterator[Mistake]:
    """Yield that P or K is exact for a game that differs by one number, the nearest game first."""
    kind, given, exact_matrix = compared.kind, compared.given, compared.exact
    # Two equal entries of the symmetric P count once.
    distinct = np.triu(exact_matrix) if kind == "P" else exact_matrix
    if np.count_nonzero(distinct) < 2:
        return  # a single number agrees with many games
    mistakes = [
        # Without the mistake, the error against this game is that against the other game.
        Mistake(f"{kind} is {says}", exact_matrix + (given - exact_of_other))
        for says, exact_of_other in other_games(exact, kind, given, compared.sizes)
    ]
    yield from sorted(mistakes, key=lambda mistake: np.max(compared.errors(mistake.undone)))


def _gain_against_implied(exact: Solution, critic: Critic, P: np.ndarray, limit: float) -> str:
    """Return a sentence on how much K differs from the gain that P implies, or ""."""
    implied = exact.game.gain((P + P.T) / 2.0)
    # The difference relative to the exact K, as the error of the exact K with this difference.
    difference = relative_error(exact.K + (critic.K - implied), exact.K)
    if difference <= limit or critic.declared.assumed:
        return ""
    return f"K differs by {percent(100.0 * difference)} from the gain that P implies on this plant"


def _sizes_of_states(exact: Solution) -> np.ndarray:
    """Return the sizes √P_ii of the states by the exact P, (n,), in balanced units at least `SMALL`
    times the largest.
    """
    units = balanced_units(exact.game)
    return floored(np.sqrt(np.abs(np.diag(exact.P))) * units) / units


def _gains(exact: Solution, K: np.ndarray, limit: float) -> Compared:
    """Return K compared with the exact one, in sizes r_i c_j of its entries, which change with the
    units of inputs and states as the entries do.
    """
    states = _sizes_of_states(exact)
    weights = np.diag(exact.suboptimality_weight)
    inputs = np.sqrt(np.where(weights > 0.0, weights, 1.0))  # √R_ii
    in_units = exact.K * inputs[:, None] / states  # from √P_jj z_j to √R_ii u_i
    # First the sizes of the columns, and then those of the rows relative to them.
    column_sizes = floored(np.linalg.norm(in_units, axis=0))
    row_sizes = floored(np.linalg.norm(in_units / column_sizes, axis=1))
    sizes = np.outer(row_sizes / inputs, column_sizes * states)
    return Compared.of("K", K, exact, sizes, limit)


def _of_value(game: Game, values: Compared) -> Iterator[Mistake]:
    """Yield the mistakes of P: a missing triangle, factors, weights for entries, order, units."""
    given, exact = values.given, values.exact
    P = (given + given.T) / 2.0
    values = values._replace(given=P)
    if not np.array_equal(given, P):
        yield Mistake("P is not symmetric; its symmetric part is exact", P)
        for half in (np.triu(given), np.tril(given)):
            says = "P is not symmetric: the value z'Pz depends on (P + P')/2 alone"
            yield Mistake(says, half + half.T - np.diag(np.diag(half)))
    says = "the value has the wrong sign: it is of rewards; V is z'Pz, of costs, and positive"
    yield Mistake(says, -P)
    if game.dt not in (None, True):  # the duration of a step is known
        says = "every entry of P is 1/dt times the exact one: the cost of a step is that of dt s"
        yield Mistake(says, float(game.dt) * P)
    yield from _factors("value", "V is z'Pz, without a factor 1/2", values)
    for too_large, factor in {
        "2 times too large: they must be W / 2": 2.0,
        "√2 times too large: they must be W / √2 of weights of √2 z_i z_j (svec)": math.sqrt(2.0),
        "√2 times too small: they must be W / √2 of weights of √2 z_i z_j (svec)": math.sqrt(0.5),
    }.items():
        says = f"the entries of P off the diagonal are {too_large}"
        yield Mistake(says, np.where(np.eye(len(P), dtype=bool), P, P / factor))
    order = _order_of_states(P, exact)
    places = np.argsort(order)
    yield Mistake(_order_text("state", order), P[np.ix_(places, places)])
    for says, divisors in _wrong_units("state", _factors_of_states(values), UNITS_OF_STATES):
        yield Mistake(says, P / np.outer(divisors, divisors))
    yield from _one_entry(values)


def _order_of_states(P: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Return the order of the states in P for which the sorted entries of rows fit best, (n,)."""
    # The sorted entries of a row do not depend on the order of the states.
    rows = np.sort(P)[:, None]
    exact_rows = np.sort(exact)[None]
    with np.errstate(all="ignore"):
        differences = np.abs(rows - exact_rows) / (np.abs(rows) + np.abs(exact_rows))
    return _assigned(np.nan_to_num(differences).sum(axis=-1))


def _factors_of_states(values: Compared) -> np.ndarray:
    """Return the factor on each state that the diagonal and the signs of P suggest, (n,)."""
    # With signs s_i of the states, the product of P_ij and the exact entry has the sign s_i s_j.
    # Signs spread from state to state along the largest products, which rounding affects least.
    products = values.given * values.exact / values.sizes**2
    signs = np.zeros(len(products))
    while not signs.all():
        # The first state without a sign begins a block of linked states; its own sign is a guess.
        block = np.arange(len(signs)) == np.argmin(np.abs(signs))
        signs[block] = 1.0
        while True:
            links = np.where(block[:, None] & (signs == 0.0), products, 0.0)
            known, linked = np.unravel_index(int(np.argmax(np.abs(links))), links.shape)
            if np.abs(links[known, linked]) <= SMALL:
                break
            block[linked] = True
            signs[linked] = signs[known] * math.copysign(1.0, links[known, linked])
        signs[block] *= math.copysign(1.0, signs[block].sum())  # most states have the right sign
    with np.errstate(all="ignore"):
        return signs * np.sqrt(np.abs(np.diag(values.given) / np.diag(values.exact)))


def _of_gain(solution: Solution, gains: Compared) -> Iterator[Mistake]:
    """Yield the mistakes of K: formula, factors, shape, order, units."""
    game, K, exact = solution.game, gains.given, gains.exact
    for says, wrong in _wrong_formulas(game, solution.P).items():
        yield Mistake(f"{says} in the formula of K", exact + (K - wrong))
    yield from _factors("gain", "the policy is u = -K z", gains)
    yield from _unmoved(game, gains)
    if K.shape[0] == K.shape[1]:
        yield Mistake("K is transposed", K.T)
    says = "K was read row by row, but its entries are stored column by column"
    yield Mistake(says, K.reshape(K.shape[::-1]).T)
    for first, signed in (("", K), ("the gain has the wrong sign, and ", -K)):
        for says, undone in _of_rows("input", UNITS_OF_INPUTS, signed, exact):
            yield Mistake(first + says, undone)
        for says, undone in _of_rows("state", UNITS_OF_STATES, signed.T, exact.T):
            yield Mistake(first + says, undone.T)
    yield from _one_entry(gains)
    yield from _multiples(game, gains)


def _wrong_formulas(game: Game, P: np.ndarray) -> dict[str, np.ndarray]:
    """Return gains by wrong formulas of the value z'P z: what is wrong -> the gain."""
    one = np.eye(len(P))
    wrong = {"P is missing": game.gain(one)}
    right = game.B.T @ P @ (game.discount * game.A if game.is_discrete else one) + game.N.T
    if not game.is_discrete:
        return {"R⁻¹ is missing": right} | wrong
    wrong["A is missing"] = replace(game, A=one).gain(P)
    if game.discount != 1.0:
        wrong["the discount is missing"] = replace(game, discount=1.0).gain(P)
    with suppress(np.linalg.LinAlgError):
        in_place = "R⁻¹ is in place of (R + B'PB)⁻¹"
        wrong[in_place] = np.linalg.solve(game.R, right)
    return wrong


def _unmoved(game: Game, gains: Compared) -> Iterator[Mistake]:
    """Yield that K never moves some inputs, whose rows are 0."""
    unmoved = np.flatnonzero(~gains.given.any(axis=1))
    if 0 < len(unmoved) < len(gains.given):
        names = [game.names.inputs[row] for row in unmoved]
        verb = "is" if len(names) == 1 else "are"
        says = f"{' and '.join(names)} {verb} never moved; the other rows of K are exact"
        undone = gains.given.copy()
        undone[unmoved] = gains.exact[unmoved]
        yield Mistake(says, undone)


def _multiples(game: Game, gains: Compared) -> Iterator[Mistake]:
    """Yield that each row of K (actions that are not mapped to the inputs), or each column (a
    normalized state), is a multiple of that of the exact K.
    """
    K, exact = gains.given, gains.exact
    in_sizes, exact_in_sizes = K / gains.sizes, exact / gains.sizes
    columns, strengths, rows = np.linalg.svd(exact_in_sizes)
    if gains.is_right(gains.sizes * strengths[0] * np.outer(columns[:, 0], rows[0])):
        return  # the exact K is of rank 1, and any K along its columns has such multiples
    for axis, noun, why, names in (
        (1, "row", "as of actions that are not mapped to the inputs", game.names.inputs),
        (0, "column", "as of a state that is normalized", game.names.states),
    ):
        with np.errstate(all="ignore"):  # factors of least squares
            factors = np.sum(in_sizes * exact_in_sizes, axis) / np.sum(exact_in_sizes**2, axis)
            undone = K / np.expand_dims(factors, axis)
        # A single number is a multiple of any other: its row or column shows nothing.
        are_shown = (np.count_nonzero(np.abs(exact_in_sizes) > SMALL, axis) > 1).all()
        if not (np.isfinite(undone).all() and factors.all() and are_shown):
            continue
        listed = ", ".join(
            f"{name} {factor:.4g}" for name, factor in zip(names, factors, strict=True)
        )
        yield Mistake(f"each {noun} of K is a multiple of the exact one ({listed}), {why}", undone)


def _of_rows(
    noun: str, units: Mapping[str, float], given: np.ndarray, exact: np.ndarray
) -> Iterator[Mistake]:
    """Yield that the rows of K are in another order, or that some have a wrong sign or unit.

    noun: what a row of the matrices is of, "input", or "state" if they are transposed
    units: unit in words -> factor on a row
    """
    column_sizes = floored(np.abs(exact).max(axis=0))
    rows, exact_rows = given / column_sizes, exact / column_sizes
    # Row i of K is nearest to the exact row order[i], where it is put without the mistake.
    order = _assigned(np.sum((rows[:, None] - exact_rows) ** 2, axis=-1))
    yield Mistake(_order_text(noun, order), given[np.argsort(order)])
    with np.errstate(all="ignore"):  # factors of least squares
        factors = np.sum(rows * exact_rows, axis=1) / np.sum(exact_rows**2, axis=1)
    for says, divisors in _wrong_units(noun, factors, units):
        yield Mistake(says, given / divisors[:, None])


def _factors(noun: str, meant: str, compared: Compared) -> Iterator[Mistake]:
    """Yield that all entries have a wrong sign, half or twice the size, or another factor.

    noun: what the matrix is, such as "gain"
    meant: definition of a right matrix, for the sentences
    """
    kind, given, exact, sizes, _ = compared
    for factor, wrong in FACTORS.items():
        yield Mistake(f"the {noun} {wrong}: {meant}", given / factor)
    # The factor of least squares. A single entry is always a multiple of the exact one.
    ratio = float(np.sum(given * exact / sizes**2) / (np.sum((exact / sizes) ** 2) or 1.0))
    if ratio and math.isfinite(ratio) and np.count_nonzero(exact) > 1:
        digits = 8 if f"{ratio:.4g}" == "1" else 4  # "1 times" would name no mistake
        yield Mistake(
            f"every entry of {kind} is {ratio:.{digits}g} times the exact one", given / ratio
        )


def _wrong_units(
    noun: str, factors: np.ndarray, units: Mapping[str, float]
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield that some states or inputs have the wrong sign or unit, and the factor of each, (k,).

    factors: factors that the matrix suggests, (k,)
    units: unit in words -> factor
    """
    for wrong, factor in {"the wrong sign": -1.0, **units}.items():
        has_factor = np.abs(factors / factor - 1.0) < NEAR
        if has_factor.any() and not has_factor.all():  # `_factors` tries one factor of all
            *numbers, last = (str(index + 1) for index in np.flatnonzero(has_factor))
            subject = f"{noun}s {', '.join(numbers)} and {last}" if numbers else f"{noun} {last}"
            singular, plural = ("has", "have") if factor == -1.0 else ("is", "are")
            verb = plural if numbers else singular
            yield f"{subject} {verb} {wrong}", np.where(has_factor, factor, 1.0)


def _assigned(distances: np.ndarray) -> np.ndarray:
    """Return the permutation (n,) with the least sum of distances[i, order[i]]."""
    from scipy.optimize import linear_sum_assignment

    return np.asarray(linear_sum_assignment(np.nan_to_num(distances))[1])


def _order_text(noun: str, order: np.ndarray) -> str:
    """Return a sentence on the order of states or inputs, which are counted from 1."""
    return f"the {noun}s are in the order {', '.join(str(index + 1) for index in order)}"


def _one_entry(compared: Compared) -> Iterator[Mistake]:
    """Yield that only one entry is wrong: the one with the largest error."""
    kind, given, exact, *_ = compared
    # Two equal entries of the symmetric P count once.
    distinct = np.triu(exact) if kind == "P" else exact
    if np.count_nonzero(distinct) < 3:
        return  # one right number beside a wrong one agrees with many mistakes
    errors = compared.errors(given)
    place = np.unravel_index(int(np.argmax(errors)), errors.shape)
    name = f"{kind}({place[0] + 1}, {place[1] + 1})"
    given_entry, exact_entry = float(given[place]), float(exact[place])
    says = (
        f"only {name} differs by more than the limit: it is {given_entry:.6g} in place of "
        f"{exact_entry:.6g}"
    )
    undone = given.copy()
    undone[place] = exact_entry
    if kind == "P":
        undone[place[::-1]] = exact_entry
    yield Mistake(says, undone)


def _of_weights(critic: Critic) -> Iterator[Mistake]:
    """Yield that weights are in another order, or lack a factor."""
    if critic.weights is None or critic.basis is None:
        return
    psi: Basis = critic.basis
    weights = critic.weights[: psi.quadratic_size]
    row, column = np.triu_indices(psi.states)
    # An order, a factor and a cost may be wrong alone or together; "" is the right one of its kind.
    orders = {
        "": np.arange(len(weights)),
        "are stored with the squares first": np.argsort(row != column, kind="stable"),
    }
    if psi.states > 2:  # for two states, both orders are equal
        orders["are stored column by column"] = np.lexsort((row, column))
    factors = {
        "": np.ones(len(weights)),
        "lack the factor 2 of products z_i z_j": np.where(row == column, 1.0, 2.0),
        "are those of products √2 z_i z_j (svec)": np.where(row == column, 1.0, math.sqrt(2.0)),
    }
    costs = {"": 1.0, "are of half the cost": 2.0}
    for order, factor, cost in itertools.product(orders, factors, costs):
        mistakes = [mistake for mistake in (order, factor, cost) if mistake]
        if mistakes:
            placed = np.empty_like(weights)
            placed[orders[order]] = weights  # row by row
            rule = "; the order must be row by row, i <= j" if order else ""
            says = f"the weights {' and '.join(mistakes)}{rule}"
            yield Mistake(says, psi.matrix(costs[cost] * factors[factor] * placed))


def _beyond_quadratic(critic: Critic) -> str:
    """Return a sentence on the largest weight of a basis function that is not quadratic, or ""."""
    if critic.weights is None or critic.basis is None:
        return ""
    beyond = critic.basis.quadratic_size
    if not critic.weights[beyond:].any():
        return ""
    index = beyond + int(np.argmax(np.abs(critic.weights[beyond:])))
    return (
        f"weight {index + 1} is {critic.weights[index]:.6g}: on a linear plant the value is "
        "quadratic, and every weight beyond the quadratic ones must be 0"
    )
