"""Smallest delta for which a game has a value, between a proved no and a proved yes.

It is sought on the scale of w = 1/δ², on which what falls to 0 there is nearly linear.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import midpoints, precision
from controller.riccati.candidate import (
    disturbance_units,
    failures,
    half_plane_in_doubles,
    half_plane_of_steps,
    pencil_in_doubles,
    stable_subspace,
)
from controller.riccati.enclosure import UndecidedError, decided_at
from controller.riccati.equation import Equation
from controller.riccati.lyapunov import FailedError, Lyapunov
from controller.riccati.rationals import disturbance_costs_nothing
from hfa_support.errors import NoSolutionError
from hfa_support.matrices import LARGEST

#: Largest relative difference of the bounds of delta_min.
TOLERANCE = 1e-6
#: Factor of 1/δ² of the first proofs beside the estimate,
FIRST_WIDTH = 1.0 + 0.75 * TOLERANCE
#: and of bounds in doubles that are near enough.
NEAR_ENOUGH = 1.0 - 0.1 * TOLERANCE
#: Smallest delta of a game; the largest is its inverse.
SMALLEST_DELTA = LARGEST**-0.5
#: Fraction of the delta at which the disturbance has an effect, below which delta_min may be 0.
NEGLIGIBLE_DELTA = 1e-12
#: If delta exceeds delta_min by a smaller fraction, a larger one is advised.
CLOSE_MARGIN = 0.01

# The others guide the search, and decide nothing: the bounds are proved.

#: The square of a decay below this fraction of that without disturbance may be 0 in doubles.
ON_AXIS = 1e-13
#: Relative change of an estimate that is then left to the proofs.
SETTLED = 0.05 * TOLERANCE
#: Largest number of estimates in doubles; six are usual.
MOST_ESTIMATES = 40
#: Exponent of the growing factor of 1/δ² of further proofs.
WIDENING = 30
#: Largest factor of 1/δ² between two estimates.
MOST_FACTOR = 1e12
#: Magnitude of a negative eigenvalue of P, relative to the P without disturbance, in doubles.
CLEARLY_NEGATIVE = 1e-2


class DeltaMin(NamedTuple):
    """Proved bounds of delta_min = inf{δ : a value exists}: refused <= delta_min <= value.

    value / refused is at most 1 + 1e-6. Both are 0 if the disturbance costs nothing. Only `refused`
    is 0 if the disturbance costs something, but no delta is refused.

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

        The clause recommends a larger delta unless delta exceeds delta_min by at least the relative
        `CLOSE_MARGIN`.
        """
        what = "; choose a larger delta"
        distance = self.margin(delta) - 1.0
        if self.refused < delta < self.value:
            where = f"at delta_min, which is between {self.refused:.9g} and {self.value:.9g}"
        elif delta < self.value:
            where = f"below delta_min = {self.value:.7g}"
        elif distance < CLOSE_MARGIN:
            where = f"only {100.0 * distance:.2g} % above delta_min = {self.value:.7g}"
        else:
            where = f"well above delta_min = {self.value:.7g}"
            what = ""
        return f"delta = {delta:.9g} is {where}{what}"


def minimum_delta(game: Game) -> DeltaMin:
    """Return proved bounds of the smallest δ for which a game has a value, at most 1e-6 apart.

    At the upper bound, a value is proved, and at the lower one, that there is none. The delta of
    the game itself does not affect the result.

    Source: Basar and Bernhard, H-infinity Optimal Control, Theorems 4.11 and 3.7.

    Raises NoSolutionError if no δ has a value; ModeError, if because of one mode.

    >>> import hfa
    >>> from controller import minimum_delta
    >>> game = hfa.Game([[1.0]], [[1.0]], Q=[[1.0]], R=[[1.0]], delta=2.0)
    >>> round(minimum_delta(game).value, 4)
    1.0
    """
    undisturbed = decided_at(game, math.inf)
    if isinstance(undisturbed, str):
        raise NoSolutionError(undisturbed)
    if disturbance_costs_nothing(game):
        return DeltaMin(0.0, 0.0)
    equation, P, gains, _ = undisturbed.proved
    with precision(undisturbed.bits):
        search = Search(equation, midpoints(P), midpoints(equation.loop(gains)))
    return _bracket(search, estimate(search))


class Distances(NamedTuple):
    """Distances from the loss of a value: one falls to 0 as w = 1/δ² grows to 1/delta_min².

    w: 1/δ²
    numbers: the square of the decay of the slowest motion, the inverse of the largest eigenvalue of
        P, and in discrete time the least weight of the disturbance, relative to δ²: nearly linear
        in w; nan without a value
    frequency: of the slowest motion, rad/s or rad/step, if it is known
    """

    w: float
    numbers: np.ndarray
    frequency: float | None = None


class _Secant:
    """What is known of w = 1/δ² on the way to 1/delta_min²: a value at `low`, and none at `high`.

    low: distances at the largest w known to have a value
    before: distances at the w that had a value before it
    high: smallest w known to have no value
    """

    def __init__(self, first: Distances) -> None:
        self.before: Distances | None = None
        self.low = first
        self.high = math.inf

    def add(self, nearer: Distances) -> None:
        """Add the distances at a larger w that has a value."""
        self.before, self.low = self.low, nearer

    def first_zero(self) -> float:
        """Return the least w at which a distance is 0 on the line through its last two, or inf."""
        if self.before is None:
            return math.inf
        with np.errstate(all="ignore"):
            fall = (self.before.numbers - self.low.numbers) / (self.low.w - self.before.w)
            to_zero = self.low.numbers / fall
        to_zero = to_zero[np.isfinite(to_zero) & (to_zero > 0.0) & (fall > 0.0)]
        return self.low.w + float(to_zero.min(initial=math.inf))

    def is_open(self, w: float) -> bool:
        """Return whether w is between what is known to have a value, and to have none."""
        return self.low.w < w < self.high

    def next_w(self, factor: float) -> float:
        """Return a w in the middle between `low` and `high`, or beyond the known one of them.

        factor: from the known one, if only one is known
        """
        low, high = self.low.w, self.high
        if math.isinf(high):
            return min(low * factor, SMALLEST_DELTA**-2)
        if low <= 0.0:
            return high / factor
        return 0.5 * (low + high) if high < 4.0 * low else math.sqrt(low) * math.sqrt(high)


class Estimate(NamedTuple):
    """Estimate of w = 1/delta_min², and the frequency of the slowest motion near it, if known."""

    w: float
    frequency: float | None


def estimate(search: Search) -> Estimate:
    """Return an estimate of 1/delta_min² in doubles, by secants of the distances."""
    first = search.in_doubles(0.0)
    secant = _Secant(first)
    # factor: of w to the next one, as long as one bound is not known
    w, factor, guess = search.first_w(), 8.0, math.inf
    for _ in range(MOST_ESTIMATES):
        distances = search.in_doubles(w)
        is_value = bool((distances.numbers > ON_AXIS * first.numbers).all())
        # Is the estimate settled?
        if is_value:
            secant.add(distances)
            last_guess, guess = guess, secant.first_zero()
            step = guess / w - 1.0  # the error of a secant is about its square
            if guess < secant.high and max(abs(guess - last_guess) / guess, step**2) <= SETTLED:
                return Estimate(guess, distances.frequency)
        else:
            secant.high = w
        # If not, the next w is near the guess of the secant, or between or beyond the bounds.
        low, high = secant.low.w, secant.high
        if not low < high * NEAR_ENOUGH:  # the bounds are near enough
            break
        if is_value and guess < high:
            w = low + 0.9 * (guess - low)  # at the guess itself, there may be no value
        else:
            w, factor = secant.next_w(factor), min(factor**1.5, MOST_FACTOR)
        if not SMALLEST_DELTA**2 < w < SMALLEST_DELTA**-2:  # a game has no such δ
            break
    if secant.low is first:  # doubles find no value
        return Estimate(search.first_w(), first.frequency)
    best = guess if guess < secant.high else secant.next_w(2.0)
    return Estimate(best, secant.low.frequency)


def _bracket(search: Search, estimate: Estimate) -> DeltaMin:
    """Return proved bounds about an estimate of 1/delta_min².

    Usually both are proved beside the estimate. If not, the distance from it grows until they are,
    and the secant through two values is the next estimate, or a w at which neither is proved: it is
    nearly on the boundary.

    Raises UndecidedError.
    """
    secant = _Secant(Distances(0.0, np.full(1, np.nan)))
    width, value, refused, was_undecided = FIRST_WIDTH, math.inf, 0.0, False
    guess, frequency = estimate
    w = guess / width
    while True:
        w = min(w, SMALLEST_DELTA**-2)
        delta = w**-0.5
        try:
            outcome = search.proved(w, frequency)
        except UndecidedError:
            if refused <= 0.0 and value < NEGLIGIBLE_DELTA * search.first_w() ** -0.5:
                return DeltaMin(value, 0.0)  # the disturbance has hardly an effect at such deltas
            if was_undecided:
                raise
            guess, width, is_value, was_undecided = w, FIRST_WIDTH, math.isfinite(value), True
        else:
            is_value, was_undecided = not isinstance(outcome, str), False
            if isinstance(outcome, str):
                refused, secant.high = delta, w
            else:
                value, frequency = delta, outcome.frequency or frequency
                secant.add(outcome)
            if value <= refused * (1.0 + TOLERANCE):
                return DeltaMin(value, refused)
            if value <= SMALLEST_DELTA * FIRST_WIDTH:
                return DeltaMin(value, 0.0)  # a game has no smaller delta that could be refused
            if secant.is_open(zero := secant.first_zero()):
                # The error of a secant is about the square of its step.
                guess, width = zero, max(FIRST_WIDTH, 1.0 + (zero / secant.low.w - 1.0) ** 2)
        # Next is the other side of the estimate, or what is farther from the known bound.
        w = guess * width if is_value else guess / width
        if not secant.is_open(w):
            width = min(width, MOST_FACTOR ** (1.0 / WIDENING)) ** WIDENING
            w = secant.low.w * width if is_value else secant.high / width
        if not secant.is_open(w):
            w = secant.next_w(width)


class Search:
    """Values of one game at many δ, in states in which P without disturbance is nearly 1.

    There, doubles have the digits that they lose in the user's states.

    equation: of the game without disturbance, in these states
    P: of the game without disturbance, in these states, (n, n)
    F: loop of the game without disturbance, (n, n)
    """

    def __init__(self, equation: Equation, P: np.ndarray, F: np.ndarray) -> None:
        self.game, self.units, self.P, self.F = equation.game, equation.units, P, F
        self.E = midpoints(equation.E)
        # L and M of the pencil in discrete time, else L is the Hamiltonian.
        if equation.is_discrete:
            self.L, self.M = pencil_in_doubles(equation)
        else:
            self.L = half_plane_in_doubles(equation)

    def first_w(self) -> float:
        """Return the w = 1/δ² at which P has grown by half its size, to the first order, or 1."""
        size, rate = float(np.abs(self.P).max()), math.nan
        with suppress(FailedError), failures():
            # dP/dw = growth solves F'growth + growth F + push push' = 0 in continuous time.
            push = self.F.T @ self.P @ self.E if self.game.is_discrete else self.P @ self.E
            growth = Lyapunov(self.F, is_discrete=self.game.is_discrete).solve(-push @ push.T)
            rate = float(np.linalg.eigvalsh(growth)[-1])
        return 0.5 * size / rate if rate > 0.0 and size > 0.0 else 1.0

    def in_doubles(self, w: float) -> Distances:
        """Return the distances at w = 1/δ², nan if doubles find no value."""
        n, is_discrete = len(self.P), self.game.is_discrete
        with suppress(FailedError), failures():
            half_plane = self.half_plane(w)
            X = stable_subspace(half_plane, n)
            poles = np.linalg.eigvals(half_plane[:n, :n] + half_plane[:n, n:] @ X)
            if is_discrete:
                poles = (1.0 + poles) / (1.0 - poles)
            decays = 1.0 - np.abs(poles) if is_discrete else -poles.real
            slowest = int(np.argmin(decays))
            decay, pole = float(decays[slowest]), poles[slowest]
            frequency = abs(float(np.angle(pole) if is_discrete else pole.imag))
            # The decay falls to 0 as the root of the change of w: its square is nearly linear.
            # Beyond the w at which P is infinite, P has large negative eigenvalues: -1 is past 0.
            sizes = np.linalg.eigvalsh(X)
            of_P = 1.0 / sizes[-1] if sizes[0] > -CLEARLY_NEGATIVE else -1.0
            numbers = [math.copysign(decay**2, decay), of_P]
            if is_discrete:  # the least weight, relative to δ²
                weight = np.eye(self.E.shape[1]) - w * self.E.T @ X @ self.E
                numbers.append(float(np.linalg.eigvalsh(weight)[0]))
            return Distances(w, np.array(numbers), frequency)
        return Distances(w, np.full(1, np.nan))

    def half_plane(self, w: float) -> np.ndarray:
        """Return the `half_plane_matrix` at w = 1/δ² in doubles.

        The worst disturbance is w E'p with the costate p, in discrete time that after the step.
        """
        n, of_disturbance = len(self.P), w * self.E @ self.E.T
        if self.game.is_discrete:
            M = self.M.copy()
            M[:n, n : 2 * n] -= of_disturbance
            return half_plane_of_steps(n, self.L, M)
        half_plane = self.L.copy()
        half_plane[:n, n:] += of_disturbance
        return half_plane

    def proved(self, w: float, frequency: float | None) -> Distances | str:
        """Return the distances at a w = 1/δ² that is proved to have a value, or why it has none.

        frequency: at which the gain from the disturbance may be too large, rad/s or rad/step

        Raises UndecidedError if neither is proved.
        """
        delta = w**-0.5
        near = self.units._replace(disturbances=disturbance_units(self.game, delta))
        outcome = decided_at(self.game, delta, near=near, frequency=frequency)
        if isinstance(outcome, str):
            return outcome
        distances = self.in_doubles(w)
        # Doubles may see no value where one is proved: a secant leaves nan out.
        numbers = np.where(distances.numbers > 0.0, distances.numbers, np.nan)
        return distances._replace(numbers=numbers)
