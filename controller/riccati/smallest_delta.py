"""Smallest delta for which a game has a value, between a proved no and a proved yes."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import BITS, DoubleBalls, midpoints, precision
from controller.riccati.enclosure import Enclosure, UndecidedError, decided
from controller.riccati.equation import Equation, equation_of
from controller.riccati.proposal import (
    FailedError,
    disturbance_units,
    loop_in_doubles,
    lyapunov_of,
    stabilizing_in_doubles,
)
from controller.riccati.rationals import costs_nothing
from controller.riccati.refusal import ModeError, why_never
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import LARGEST

#: Largest relative difference of the bounds of delta_min.
TOLERANCE = 1e-6
#: Factor of 1/δ² of the first proofs beside the estimate,
BESIDE = 1.0 + 0.75 * TOLERANCE
#: and of bounds in doubles that are near enough.
SAME = 1.0 - 0.1 * TOLERANCE
#: The square of a decay below this fraction of that without disturbance may be 0 in doubles.
ON_AXIS = 1e-13
#: Relative change of an estimate that is then left to the proofs.
SETTLED = 0.05 * TOLERANCE
#: Smallest delta of a game.
LEAST = LARGEST**-0.5
#: Largest number of estimates in doubles; six are usual.
MOST_ESTIMATES = 40
#: Magnitude of a negative eigenvalue of P, relative to the P without disturbance, in doubles.
INDEFINITE = 1e-2
#: If delta exceeds delta_min by a smaller fraction, a larger one is advised.
CLOSE = 0.01


class DeltaMin(NamedTuple):
    """Proved bounds of delta_min = inf{δ : a value exists}: refused <= delta_min <= value.

    value / refused is at most 1 + 1e-6. Both are 0 if the disturbance costs nothing.

    value: a delta with a value
    refused: a delta without a value
    """

    value: float
    refused: float

    def margin(self, delta: float) -> float:
        """Return the ratio delta / delta_min, or inf if delta_min is 0.

        If the ratio is above 1, the game with this delta has a value.
        """
        return delta / self.value if self.value > 0.0 else math.inf

    def advice(self, delta: float) -> str:
        """Return a clause for an error message that compares a delta with delta_min.

        The clause recommends a larger delta unless delta exceeds delta_min by at least `CLOSE`
        (relative).
        """
        what = "; choose a larger delta"
        excess = self.margin(delta) - 1.0
        if self.refused < delta < self.value:
            where = f"at delta_min, which is between {self.refused:.9g} and {self.value:.9g}"
        elif delta < self.value:
            where = f"below delta_min = {self.value:.7g}"
        elif excess < CLOSE:
            where = f"only {100.0 * excess:.2g} % above delta_min = {self.value:.7g}"
        else:
            where = f"well above delta_min = {self.value:.7g}"
            what = ""
        return f"delta = {delta:.9g} is {where}{what}"


def minimum_delta(game: Game) -> DeltaMin:
    """Return proved bounds of the smallest δ for which a game has a value, at most 1e-6 apart.

    At the upper bound, a value is proved, and at the lower one, that there is none. The delta of
    the game itself does not affect the result.

    Source: Basar and Bernhard, H-infinity Optimal Control, Theorems 4.11 and 3.7.

    Raises NoSolutionError if no δ has a value. The message names the responsible mode.

    >>> import hfa
    >>> from controller import minimum_delta
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> round(minimum_delta(game).value, 4)
    1.0
    """
    undisturbed = decided(game, math.inf, digits=False)
    if isinstance(undisturbed, str):
        raise (ModeError if undisturbed == why_never(game) else NoSolutionError)(undisturbed)
    if costs_nothing(game):
        return DeltaMin(0.0, 0.0)
    search = _Search(game, undisturbed)
    return _bracket(search, _estimate(search))


class _Left(NamedTuple):
    """Numbers that fall to 0 as 1/δ² grows to 1/delta_min², nearly linearly near it.

    square: 1/δ²
    numbers: the square of the decay of the slowest motion, the inverse of the growth of P, and in
        discrete time the price of the disturbance
    """

    square: float
    numbers: np.ndarray


class _Secant:
    """The last two values on the way to delta_min, and where their numbers reach 0.

    high: smallest 1/δ² known to have no value
    """

    def __init__(self, first: _Left) -> None:
        self.before: _Left | None = None
        self.low = first
        self.high = math.inf

    def add(self, found: _Left) -> None:
        """Add a value nearer to delta_min."""
        self.before, self.low = self.low, found

    def zero(self) -> float:
        """Return the 1/δ² at which the line through the last two values has its first 0."""
        if self.before is None:
            return math.inf
        with np.errstate(all="ignore"):
            fall = (self.before.numbers - self.low.numbers) / (self.low.square - self.before.square)
            ahead = self.low.numbers / fall
        ahead = ahead[np.isfinite(ahead) & (ahead > 0.0) & (fall > 0.0)]
        return self.low.square + float(ahead.min(initial=math.inf))


def _estimate(search: _Search) -> float:
    """Return an estimate of 1/delta_min² in doubles, by secants, each nine tenths of the way."""
    first = search.in_doubles(0.0)
    secant = _Secant(first)
    square, guess = search.first_square(), math.inf
    for _ in range(MOST_ESTIMATES):
        found = search.in_doubles(square)
        is_value = bool((found.numbers > ON_AXIS * first.numbers).all())
        if is_value:
            secant.add(found)
            last, guess = guess, secant.zero()
            if abs(guess - last) <= SETTLED * guess:
                break
        else:
            secant.high = square
        low, high = secant.low.square, secant.high
        if not low < high * SAME:
            break
        if is_value and guess < high:
            square = low + 0.9 * (guess - low)
        elif math.isinf(high):
            square = 8.0 * square
        else:
            square = 0.5 * (low + min(high, guess))
        if not 0.0 < square < LEAST**-2:
            break
    return guess if guess < secant.high else math.sqrt(square * secant.low.square) or square


def _bracket(search: _Search, guess: float) -> DeltaMin:
    """Return proved bounds about an estimate of 1/delta_min².

    Raises UndecidedError.
    """
    secant = _Secant(search.in_doubles(0.0))
    square, step, value, refused = guess / BESIDE, BESIDE, math.inf, 0.0
    for count in itertools.count(1):
        delta = square**-0.5
        outcome = search.proved(delta)
        if isinstance(outcome, str):
            refused, secant.high = delta, square
            square = secant.zero() / BESIDE
        else:
            value = delta
            secant.add(outcome)
            square = secant.zero() * BESIDE if count > 1 else guess * BESIDE
        if value <= refused * (1.0 + TOLERANCE):
            break
        if value <= LEAST * BESIDE:
            return DeltaMin(value, 0.0)
        low, high = secant.low.square, secant.high
        step *= step
        if math.isinf(high):
            square = min(max(square, low * step), LEAST**-2)
        elif count % 3 == 0 or not low / SAME < square < high * SAME:
            square = math.sqrt(low * high) if 0.1 * high < low else 0.3 * high
    return DeltaMin(value, refused)


class _Search:
    """Values of one game at many δ, in exact units in which P without disturbance is near 1."""

    def __init__(self, game: Game, undisturbed: Enclosure) -> None:
        self.game = game
        self.units = undisturbed.proved.equation.units
        self.P = midpoints(undisturbed.proved.X)
        values, vectors = np.linalg.eigh(self.P)
        least = max(float(values[-1]), 0.0) * np.finfo(float).eps ** 0.75 or 1.0
        self.to_level = vectors / np.sqrt(np.maximum(values, least))

    def equation(self, square: float) -> Equation[DoubleBalls]:
        """Return the equation at 1/δ²."""
        delta = math.inf if square == 0.0 else square**-0.5
        units = self.units._replace(disturbances=disturbance_units(self.game, delta))
        return equation_of(self.game, units, DoubleBalls, delta)

    def first_square(self) -> float:
        """Return the 1/δ² at which P has grown by half its size, to the first order."""
        with precision(BITS):
            equation = self.equation(0.0)
            try:
                F, E = loop_in_doubles(equation, self.P), equation.E.midpoint
                push = F.T @ self.P @ E if equation.is_discrete else self.P @ E
                lyapunov = lyapunov_of(F, is_discrete=equation.is_discrete)
                growth, _ = lyapunov.solve(-push @ push.T)
                rate = float(np.linalg.eigvalsh(self.to_level.T @ growth @ self.to_level)[-1])
            except (np.linalg.LinAlgError, ValueError):
                rate = math.nan
        return 0.5 / rate if rate > 0.0 else 1.0

    def in_doubles(self, square: float) -> _Left:
        """Return the numbers at 1/δ², nan if doubles find no value."""
        with precision(BITS), np.errstate(all="ignore"):
            try:
                equation = self.equation(square)
                return self.left(square, stabilizing_in_doubles(equation), equation)
            except (np.linalg.LinAlgError, ValueError, FailedError):
                return _Left(square, np.full(1, np.nan))

    def proved(self, delta: float) -> _Left | str:
        """Return the numbers at a δ that is proved to have a value, or why it has none.

        A δ at which neither is proved is exactly on a boundary: the next one is taken.

        Raises UndecidedError if that does not help.
        """
        try:
            outcome = decided(self.game, delta, digits=False)
        except UndecidedError:
            outcome = decided(self.game, np.nextafter(delta, 0.0), digits=False)
        if isinstance(outcome, str):
            return outcome
        steps = self.units.states - outcome.proved.equation.units.states
        square = delta**-2
        with precision(BITS), np.errstate(all="ignore"):
            X = np.ldexp(midpoints(outcome.proved.X), np.add.outer(steps, steps))
            try:
                found = self.left(square, X, self.equation(square))
            except (np.linalg.LinAlgError, ValueError):
                return _Left(square, np.full(1, np.nan))
        return found._replace(numbers=np.where(found.numbers > 0.0, found.numbers, np.nan))

    def left(self, square: float, X: np.ndarray, equation: Equation[DoubleBalls]) -> _Left:
        """Return the numbers of the stabilizing solution X at 1/δ²."""
        values = np.linalg.eigvals(loop_in_doubles(equation, X))
        sizes = np.linalg.eigvalsh(self.to_level.T @ X @ self.to_level)
        decay = 1.0 - np.abs(values).max() if equation.is_discrete else -values.real.max()
        # Beyond its growth to infinity, P has large negative eigenvalues.
        growth = 1.0 / sizes[-1] if sizes[0] > -INDEFINITE else -1.0
        numbers = [math.copysign(decay**2, decay), growth]
        if equation.is_discrete:
            E = equation.E.midpoint * np.exp2(-equation.units.disturbances.astype(float))
            numbers.append(1.0 - square * float(np.linalg.eigvalsh(E.T @ X @ E)[-1]))
        return _Left(square, np.array(numbers))
