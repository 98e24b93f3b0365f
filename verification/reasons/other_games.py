"""Search for another game that a critic solves.

The game may have another delta, Q, R, discount, time step or scheduling value. For one parameter,
the search finds the game whose solution is closest to the critic. Diagonal Q and R follow from P,
because the Riccati equation is linear in Q and R⁻¹.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare import quick_solution, unconfirmed_solution
from controller.riccati.normal_form import NormalForm
from controller.riccati.smallest_delta import minimum_delta
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.matrices import spectral_radius
from verification.reasons.hypotheses import (
    EXACT,
    OF_NETWORKS,
    REDUNDANT,
    Hypothesis,
    View,
    error_of,
)
from verification.scope import Nearby

#: Initial values of searches: factors on 1/delta², Q, R and discount, and time steps, s.
_FACTORS = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
_TIMES = (1e-3, 1e-2, 5e-2, 0.2, 1.0)
#: Largest number of steps of a search, and the relative step of its derivative.
_STEPS = 30
_STEP = 1e-5
#: Difference where no game exists, relative to that of the initial value.
_NO_GAME = 1e3
#: A search must reduce the difference to this fraction of that of the best initial value, or to
#: rounding.
_REACHED = 0.1
ROUNDING = 1e-9
#: Largest discount relative to the fastest rate of the plant, and least and largest time step
#: relative to the inverse of this rate.
_FASTER = 10.0
_SHORTEST_STEP = 1e-4
_LONGEST_STEP = 10.0
#: If a smaller fraction of the error remains, a critic is the LQR. Above it, a game that is almost
#: the LQR would look alike.
_SAME = 1e-6
#: Entries of Q and R with a smaller relative difference are equal.
_SAME_WEIGHT = 1e-3


class Answer(NamedTuple):
    """Solution of a game.

    P: matrix of the value, (n, n), or None if only the gain is known.
    K: gain, (m, n).
    """

    P: np.ndarray | None
    K: np.ndarray

    def of_kind(self, kind: str) -> np.ndarray:
        """Return P or K, by its name."""
        matrix = self.P if kind == "P" else self.K
        assert matrix is not None  # views of P are made only where P is known
        return matrix


class Family(NamedTuple):
    """Games with one parameter x, or a single game.

    says: (noun of the critic's matrix, x) -> sentence that names the game.
    answer: x -> solution of the game. Raises NoSolutionError if no solution exists.
    starts: initial values of a search for x, () for a single game.
    is_lqr: whether the game has no disturbance.
    plausible: lowest and highest x that are plausible for the plant, or None for the interval of
        `starts`, extended by its length on both sides.
    """

    says: Callable[[str, float], str]
    answer: Callable[[float], Answer]
    starts: tuple[float, ...] = ()
    is_lqr: bool = False
    plausible: tuple[float, float] | None = None

    @property
    def limits(self) -> tuple[float, float]:
        """Lowest and highest x in a search."""
        lowest = min(self.starts)
        highest = max(self.starts)
        return self.plausible or (2.0 * lowest - highest, 2.0 * highest - lowest)


class OtherGames(Protocol):
    """Hypotheses that a critic solves another game than the one to be solved."""

    def of_matrix(self, view: View) -> Iterator[Hypothesis]:
        """Yield hypotheses that a critic given by P or K solves another game."""

    def of_network(self, view: View) -> Iterator[Hypothesis]:
        """Yield hypotheses that a network, represented by a matrix, solves another game."""


def other_games(game: Game, nearby: Nearby | None = None) -> OtherGames:
    """Return the other games that a critic may solve by mistake.

    nearby: other games in continuous time, or None
    """
    if game.is_discrete:
        return _OtherSteps(game)
    return _OtherTimes(game, nearby or Nearby())


class _OtherTimes:
    """Hypotheses that a critic of a game in continuous time solves another game."""

    def __init__(self, game: Game, nearby: Nearby) -> None:
        self.game = game
        self._families = lru_cache(lambda: families(game, nearby))

    def of_matrix(self, view: View) -> Iterator[Hypothesis]:
        """Yield hypotheses that a critic given by P or K solves another game."""
        allowed = math.inf
        lqr = [family for family in self._families() if family.is_lqr]
        for hypothesis in answers(view, lqr, EXACT.left[""]):
            left = error_of(view, hypothesis.undo)
            if left <= _SAME * error_of(view, view.judged):
                yield hypothesis
            else:
                allowed = left * EXACT.left[""]
        for hypothesis in self._without_lqr(view):
            if error_of(view, hypothesis.undo) <= allowed:
                yield hypothesis

    def _without_lqr(self, view: View) -> Iterator[Hypothesis]:
        games: list[Family] = [family for family in self._families() if not family.is_lqr]
        yield from answers(view, games, EXACT.left[""])
        if view.kind == "P":
            for says, answer in other_weights(self.game, view.judged):
                yield is_answer(view, answer, says)

    def of_network(self, view: View) -> Iterator[Hypothesis]:
        """Yield hypotheses that a network solves another game."""
        yield from answers(view, self._families(), OF_NETWORKS.left[""])


class _OtherSteps:
    """Hypotheses that a critic of a game in discrete time solves another game."""

    def __init__(self, problem: Game) -> None:
        self.problem = problem

    def of_matrix(self, view: View) -> Iterator[Hypothesis]:
        """Yield games in continuous time, or without disturbance, discount or cross weights."""
        problem = self.problem
        if problem.continuous is not None:
            says = "in continuous time, without discount"
            game = problem.continuous
        else:
            says = 'of x\' = A x + B u; did you mean time = "continuous"?'
            game = replace(problem, dt=None, discount=1.0)
        with contextlib.suppress(NoSolutionError):
            solution = unconfirmed_solution(game)
            yield is_answer(view, Answer(solution.P, solution.K), f"this is the {view.noun} {says}")
        others = {
            "without disturbance (delta = inf)": problem.with_delta(math.inf),
            "without discount": replace(problem, discount=1.0),
            "without cross weights N": replace(problem, N=0.0 * problem.N),
        }
        for says, other in others.items():
            with contextlib.suppress(NoSolutionError):
                answer = Answer(*quick_solution(other))
                yield is_answer(view, answer, f"this is the {view.noun} {says}")

    def of_network(self, view: View) -> Iterator[Hypothesis]:
        """Yield the hypotheses of `of_matrix`."""
        return self.of_matrix(view)


def families(game: Game, nearby: Nearby) -> list[Family]:
    """Return the games that a critic of a given game may solve instead.

    - The LQR, if `game` has a finite delta.
    - The games named in `nearby`.
    - Games with another delta, scheduling value, scale of Q or R, or discount.
    - Games in discrete time, with A and B as matrices of a step, or sampled.
    """
    lqr = game.with_delta(math.inf)
    is_game = math.isfinite(game.delta)
    size = game.delta if is_game else minimum_delta(game).value
    members = []
    if is_game:
        members.append(_lqr(game, lqr))
    if size > 0.0:  # P and K are smooth functions of x, proportional to 1/δ²
        members.append(
            _another(
                lambda x: f"at delta = {size / math.sqrt(x):.4g}",
                lambda x: game.with_delta(size / math.sqrt(x)),
                _FACTORS,
            )
        )
    for description, neighbour in nearby.named.items():
        if neighbour.B.shape == game.B.shape:
            members.append(_named(description, neighbour))
    if nearby.scheduled is not None:
        members.append(_another(*nearby.scheduled))
    if game.N.any():
        members.append(_named("without cross weights N", replace(game, N=0.0 * game.N)))
    else:
        members += [
            _along_log("with Q", "times as large", lambda x: replace(game, Q=x * game.Q)),
            _along_log("with R", "times as large", lambda x: replace(game, R=x * game.R)),
        ]
    rate = fastest_rate(game)
    discount = _along_log("with a discount of", "1/s", lambda x: discounted(game, x))
    members.append(discount._replace(plausible=(-math.inf, math.log(_FASTER * rate))))
    members.append(
        Family(
            lambda noun, _: (
                f'this is the {noun} of x⁺ = A x + B u; did you mean time = "discrete"?'
            ),
            lambda _: Answer(*quick_solution(replace(game, dt=True))),
        )
    )
    members += _in_steps("of another game", game, rate)
    if is_game:
        members += _in_steps("of the LQR", lqr, rate)
    return members


def _lqr(game: Game, lqr: Game) -> Family:
    """Return the family that contains only the game without disturbance, `lqr`."""
    without = f"(delta = inf), not the game's at delta = {game.delta:.6g}"
    return Family(
        lambda noun, _: f"this is the LQR {noun} {without}", lambda _: solved(lqr), is_lqr=True
    )


def _another(
    says: Callable[[float], str],
    game_at: Callable[[float], Game],
    starts: tuple[float, ...] = (),
) -> Family:
    """Return a family of games in continuous time."""
    return Family(
        lambda noun, x: f"this is the {noun} of another game, {says(x)}",
        lambda x: solved(game_at(x)),
        starts,
    )


def _named(description: str, game: Game) -> Family:
    """Return the family that contains a single game."""
    return _another(lambda _: description, lambda _: game)


def _along_log(what: str, unit: str, game_at: Callable[[float], Game]) -> Family:
    """Return the family of games with a positive parameter, exp(x)."""
    return _another(
        lambda x: f"{what} {math.exp(x):.4g} {unit}",
        lambda x: game_at(math.exp(x)),
        tuple(math.log(factor) for factor in _FACTORS),
    )


def fastest_rate(game: Game) -> float:
    """Return the largest |eigenvalue| of A and of A - B K, rad/s, or 1 if all are 0.

    A - B K is omitted if the game has no solution.
    """
    loops = [game.A]
    with contextlib.suppress(NoSolutionError):
        loops.append(game.A - game.B @ solved(game).K)
    return max(spectral_radius(loop) for loop in loops) or 1.0


def _in_steps(whose: str, game: Game, rate: float) -> Iterator[Family]:
    """Yield families of games in discrete time, with a time step of exp(x) s."""
    # - inputs held over a step,
    # - inputs held over a step, with a cost that is not multiplied by the step,
    # - Euler's rule.
    starts = tuple(math.log(time) for time in _TIMES)
    plausible = (math.log(_SHORTEST_STEP / rate), math.log(_LONGEST_STEP / rate))
    held_at = lru_cache(maxsize=None)(partial(held, game))  # the first two seek the same steps
    for how, answer in (
        ("", held_at),
        (" and its whole cost", lambda step: of_whole_cost(held_at(step), step)),
        (" of x + (A x + B u) dt", partial(euler, game)),
    ):
        stepped = _stepped(f"{whose}, in discrete time", how, answer)
        yield stepped._replace(starts=starts, plausible=plausible)


def _stepped(whose: str, how: str, answer: Callable[[float], Answer]) -> Family:
    return Family(
        lambda noun, x: f"this is the {noun} {whose}, a step of {math.exp(x):.4g} s{how}",
        lambda x: answer(math.exp(x)),
    )


def solved(game: Game) -> Answer:
    """Return the solution of a game without refinement and without a certificate.

    Raises NoSolutionError if no solution exists.
    """
    return Answer(*quick_solution(game))


def discounted(game: Game, rate: float) -> Game:
    """Return the game whose P belongs to the cost ∫ e^(-rate t) (z'Qz + u'Ru - δ² d'd) dt.

    rate: 1/s
    """
    return replace(game, A=game.A - 0.5 * rate * np.eye(len(game.A)))


def held(game: Game, step: float) -> Answer:
    """Return the solution of a game with u and d held over each time step.

    step: time step, s
    """
    return Answer(*quick_solution(game.sampled(step)))


def of_whole_cost(answer: Answer, step: float) -> Answer:
    """Return the solution of a sampled game whose cost is not multiplied by the time step.

    answer: solution for a cost that is multiplied by the time step
    step: time step, s
    """
    return Answer(answer.of_kind("P") / step, answer.K)


def euler(game: Game, step: float) -> Answer:
    """Return the solution of a game in discrete time by Euler's rule.

    The rule is x⁺ = x + (A x + B u + E d) step. The cost of a step is multiplied by the time step.

    step: time step, s
    """
    A = np.eye(len(game.A)) + step * game.A
    of_step = Game(
        A=A,
        B=step * game.B,
        E=step * game.E,
        Q=step * game.Q,
        R=step * game.R,
        delta=math.sqrt(step) * game.delta,
        N=step * game.N,
        dt=step,
    )
    return Answer(*quick_solution(of_step))


def is_answer(view: View, answer: Answer, says: str) -> Hypothesis:
    """Return the hypothesis that the critic solves another game.

    answer: solution of the other game
    says: sentence that names the game
    """
    matrix = answer.of_kind(view.kind)
    return Hypothesis(says, view.judged - matrix + view.exact, answer=matrix)


def answers(view: View, candidates: list[Family], explained: float) -> Iterator[Hypothesis]:
    """Yield, for each family of games, the hypothesis of the game that is closest to the critic.

    A family with a parameter is omitted if the critic has too few entries, or if the search does
    not succeed.

    candidates: families of games
    explained: part of the difference that a search may leave
    """
    few = view.known <= REDUNDANT  # a few numbers agree with many games
    for family in candidates:
        x: float | None = 0.0
        if family.starts:
            x = None if few else _nearest(view, family, explained)
        if x is not None:
            with contextlib.suppress(NoSolutionError):
                yield is_answer(view, family.answer(x), family.says(view.noun, x))


def other_weights(game: Game, P: np.ndarray) -> Iterator[tuple[str, Answer]]:
    """Yield (sentence, solution) for games with another diagonal Q or R whose value may be P.

    The Riccati equation A'P + P A + Σ q_i e_i e_i' - P (Σ b_j b_j' / r_j - δ⁻² E E') P = 0 is
    linear in q and 1/r, and is solved for q or for 1/r by least squares.

    game: game whose weights are varied. A Q or R that is not diagonal is not varied, nor are the
        weights of a game with cross weights.
    P: matrix of the critic's value, (n, n)
    """
    if not P.any() or game.N.any():
        return
    form = NormalForm.of(game)
    P = form.of_value((P + P.T) / 2.0)
    by_input = P @ form.B
    by_disturbance = P @ form.E
    constant = form.A.T @ P + P @ form.A + by_disturbance @ by_disturbance.T
    if _is_diagonal(game.Q):
        squares = [np.diag(row) for row in np.eye(len(P))]
        fitted = _fitted(squares, constant - by_input @ by_input.T)
        if fitted is not None:
            diagonal = fitted / form.units**2
            yield from _with_weights(game, "Q", "state", diagonal)
    if _is_diagonal(game.R):
        squares = [-np.outer(column, column) for column in (P @ form.inputs).T]
        fitted = _fitted(squares, constant + form.Q)
        if fitted is not None and np.all(fitted > 0.0):
            yield from _with_weights(game, "R", "input", 1.0 / fitted)


def _is_diagonal(matrix: np.ndarray) -> bool:
    return bool(np.array_equal(matrix, np.diag(np.diag(matrix))))


def _fitted(terms: list[np.ndarray], constant: np.ndarray) -> np.ndarray | None:
    """Return the least-squares solution x of Σ x_i terms_i + constant = 0, or None."""
    upper = np.triu_indices(len(constant))
    matrix = np.array([term[upper] for term in terms]).T
    if len(matrix) < matrix.shape[1] + REDUNDANT:
        return None
    return np.linalg.lstsq(matrix, -constant[upper], rcond=None)[0]


def _with_weights(
    game: Game, name: str, noun: str, diagonal: np.ndarray
) -> Iterator[tuple[str, Answer]]:
    """Yield the sentence and the solution for a game with another diagonal Q or R."""
    weights = np.diag(getattr(game, name))
    changed = np.flatnonzero(np.abs(diagonal - weights) > _SAME_WEIGHT * np.abs(weights))
    says = f"with {name} = diag({', '.join(f'{entry:.4g}' for entry in diagonal)})"
    if len(changed) == 1 and weights[changed[0]] != 0.0:
        (index,) = changed
        factor = diagonal[index] / weights[index]
        says = f"with {name} of {noun} {index + 1} {factor:.4g} times as large"
    with contextlib.suppress(NoSolutionError, BadInputError, np.linalg.LinAlgError):
        changes: dict[str, Any] = {name: np.diag(diagonal)}
        yield f"this is the solution of another game, {says}", solved(replace(game, **changes))


def _nearest(view: View, family: Family, explained: float) -> float | None:
    """Return the parameter x of the game in a family that is closest to the critic, or None."""
    from scipy.optimize import least_squares

    lowest, highest = family.limits
    differences: dict[float, np.ndarray | None] = {
        start: _difference(view, family, start)
        for start in family.starts
        if lowest < start < highest
    }
    sizes = {x: float(np.linalg.norm(d)) for x, d in differences.items() if d is not None}
    if not sizes:
        return None
    begin = min(sizes, key=lambda start: sizes[start])
    nowhere = np.full(view.judged.size, _NO_GAME * max(sizes[begin], ROUNDING))

    def residuals(parameter: np.ndarray) -> np.ndarray:
        (x,) = parameter.tolist()
        if x not in differences:
            differences[x] = _difference(view, family, x)
        away = differences[x]
        return nowhere if away is None else away

    end = least_squares(
        residuals,
        [begin],
        bounds=family.limits,
        ftol=0.1,
        xtol=1e-14,
        gtol=1e-15,
        diff_step=_STEP,
        max_nfev=_STEPS,
    )
    difference_left = float(np.linalg.norm(end.fun))
    enough = max(_REACHED * sizes[begin], explained, ROUNDING)
    return float(end.x[0]) if difference_left <= enough else None


def _difference(view: View, family: Family, x: float) -> np.ndarray | None:
    """Return the relative difference of the critic's matrix from a game's, or None without game."""
    try:
        with np.errstate(divide="raise", invalid="raise"):
            matrix = family.answer(x).of_kind(view.kind)
            away = (matrix - view.judged) * view.weights
            return np.ravel(away / np.linalg.norm(matrix * view.weights))
    except (NoSolutionError, BadInputError, ValueError, ArithmeticError):
        return None
