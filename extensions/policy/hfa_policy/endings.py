"""Ends of flights of a deployed policy, decided window by window: convergence, limit cycles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hfa_aircraft.march.ending import Outcome, is_within
from hfa_aircraft.march.march import History

#: A flight from a trim has settled if no state changes more in a window, in nominal values.
STILL = 1e-9
#: Half-widths of the ball within which a flight has converged, in half-widths of the
#: initial-condition box.
BALL = 0.05
#: Function from states (..., s) to the lowest and the highest states of a step, (..., n) each.
Extremes = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def settled(still: np.ndarray) -> Callable[[History], np.ndarray]:
    """Return the rule for `march` that all flights are over when all have settled.

    A flight has settled if no state changes by more than `still` from the start to the end of a
    window.

    still: (n,)
    """

    def over(flown: History) -> np.ndarray:
        moved = np.abs(flown.states[:, -1, : len(still)] - flown.states[:, 0, : len(still)])
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        mask[:, -1] = (moved <= still).all()
        return mask

    return over


class Motion(NamedTuple):
    """Motion of N flights in a window, in half-widths of the ball in which a flight has converged.

    distance: largest distance from the equilibrium, (N,), inf without an equilibrium
    swings: half the range of each state, (N, k), 0 for a state that does not count
    """

    distance: np.ndarray
    swings: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Patience:
    """Numbers of windows, and tolerances, by which a flight ends before its full duration.

    standing: a flight is at another equilibrium if in this number of consecutive windows its motion
        is at most `stands` times its distance, which exceeds `elsewhere` balls
    block: a flight is in a limit cycle if the least half range of a state in each of the last three
        blocks of this number of windows is at least `cycles` balls, equal in all to within `same`,
        and neither only rises nor only falls
    growth: a flight about an unstable equilibrium has converged, and chatters in the ball, only if
        its distance grew by less than the factor `grown` in its last `growth` windows
    """

    standing: int
    stands: float
    elsewhere: float
    block: int
    cycles: float
    same: float
    growth: int
    grown: float


#: This is measured, not proved: of 26,000 flights of 5 policies with 0 to 5 samples of delay, each
#: had the outcome of its full duration. With `same` = 0.05, 24 of 19,200 had not, because of slow
#: decay or growth.
PATIENCE = Patience(
    standing=10,
    stands=1e-3,
    elsewhere=2.0,
    block=5,
    cycles=3.0,
    same=0.002,
    growth=10,
    grown=1.02,
)


class Endings:
    """How N flights end, decided window by window while `march` simulates them.

    A flight ends with the window in which the first of these cases applies:

    - It has left the limits, or a state is not a number.
    - It has converged: it was in the ball for `enough` windows, and its distance does not increase.
      It must be certain to stay there (`stays`).
    - It is in a limit cycle or at another equilibrium (`Patience`).

    A flight of the full duration converges if it ends in the ball, and its distance does not grow
    about an unstable equilibrium.

    outcomes: `Outcome` of each flight, (N,)
    nearest: distance of each flight in its last window, (N,)
    left_at: number of the step at which each flight left the limits, (N,)
    left_with: states at this step, (N, n)
    """

    def __init__(
        self,
        limits: tuple[np.ndarray, np.ndarray],
        motion: Callable[[History], Motion],
        windows: int,
        *,
        enough: np.ndarray,
        stays: np.ndarray,
        stable: np.ndarray,
        counted: int,
        patience: Patience,
        extremes: Extremes | None = None,
    ) -> None:
        """Begin with N undecided flights.

        limits: least and most value of each state, (N, n) each
        motion: motion of the flights in a window
        windows: number of windows in the full duration
        enough: number of windows in the ball after which a flight has converged, (N,)
        stays: True for flights that cannot leave the ball again, (N,)
        stable: True for flights about a stable equilibrium, (N,)
        counted: number k of the states whose motion is observed
        extremes: function from the states of a history to the lowest and the highest states of
            each step, which must be within the limits, or None for the states themselves
        """
        count, n = limits[0].shape
        self.outcomes = np.full(count, Outcome.UNDECIDED, dtype=object)
        self.nearest = np.full(count, np.inf)
        self.left_at = np.zeros(count, dtype=int)
        self.left_with = np.full((count, n), np.nan)
        self._least, self._most = limits
        self._motion = motion
        self._windows = windows
        self._enough = enough
        self._stays = stays
        self._stable = stable
        self._patience = patience
        self._extremes = extremes
        self._earlier = np.full(count, np.inf)
        self._in_ball = np.zeros(count, dtype=int)
        self._standing = np.zeros(count, dtype=int)
        self._swings = np.full((3, count, counted), np.inf)

    def over(self, flown: History) -> np.ndarray:
        """Return a mask (F, T + 1), True at the end of a window in which a flight ends."""
        flying = flown.flights
        number = flown.first // (flown.states.shape[1] - 1)
        if number == self._windows - self._patience.growth:
            self._earlier[flying] = self.nearest[flying]
        distance, swings = self._motion(flown)
        left = self._mark_departures(flown)
        back = self._back(flying, distance)
        cycling = self._cycling(flying, swings, number)
        standing = self._stands(flying, distance, swings)
        self.nearest[flying] = distance
        self.outcomes[flying[standing]] = Outcome.ELSEWHERE
        self.outcomes[flying[cycling]] = Outcome.CYCLES
        self.outcomes[flying[back]] = Outcome.CONVERGED
        self.outcomes[flying[left]] = Outcome.LEFT
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        mask[:, -1] = left | back | cycling | standing
        return mask

    def close(self) -> None:
        """Decide the flights of the full duration: those that end in the ball have converged."""
        grows = self.nearest > self._patience.grown * self._earlier
        back = (self.nearest <= 1.0) & (self._stable | ~grows)
        self.outcomes[(self.outcomes == Outcome.UNDECIDED) & back] = Outcome.CONVERGED

    def _mark_departures(self, flown: History) -> np.ndarray:
        """Return a mask of the flights that left their limits, and store when and with what.

        A flight leaves with the first step whose extremes are not all within its limits.
        """
        flights = flown.flights
        states = flown.states[:, :, : self._least.shape[1]]  # the first ones have limits
        if self._extremes is None:
            lowest_each_step, highest_each_step = states, states
        else:
            lowest_each_step, highest_each_step = self._extremes(flown.states)
        least, most = self._least[flights], self._most[flights]
        left = _has_left(lowest_each_step, highest_each_step, least, most)
        left |= ~np.isfinite(states[:, -1]).all(axis=1)
        for row in np.flatnonzero(left):
            low, high = lowest_each_step[row], highest_each_step[row]
            inside = is_within(low, least[row], most[row]) & is_within(high, least[row], most[row])
            step = int(inside.argmin())
            flight = flights[row]
            self.left_at[flight] = flown.first + step
            # Of each state, the extreme that is beyond its limit, or the highest value.
            self.left_with[flight] = np.where(low[step] < least[row], low[step], high[step])
        return np.asarray(left)

    def _back(self, flying: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return a mask of the flights that have converged."""
        self._in_ball[flying] = np.where(distance <= 1.0, self._in_ball[flying] + 1, 0)
        is_long = self._in_ball[flying] >= self._enough[flying]
        return np.asarray(self._stays[flying] & is_long & (distance <= self.nearest[flying]))

    def _stands(self, flying: np.ndarray, distance: np.ndarray, swings: np.ndarray) -> np.ndarray:
        """Return a mask of the flights that have settled at another equilibrium."""
        patience = self._patience
        is_away = np.isfinite(distance) & (distance > patience.elsewhere)
        stands = is_away & (swings.max(axis=1) <= patience.stands * distance)
        self._standing[flying] = np.where(stands, self._standing[flying] + 1, 0)
        return np.asarray(self._standing[flying] >= patience.standing)

    def _cycling(self, flying: np.ndarray, swings: np.ndarray, number: int) -> np.ndarray:
        """Return a mask of the flights in a limit cycle, decided at the end of each block."""
        patience = self._patience
        this, last, before_last = self._swings[:, flying]
        this = np.minimum(this, swings)
        if (number + 1) % patience.block:
            self._swings[0, flying] = this
            return np.zeros(len(flying), dtype=bool)
        least = np.minimum(np.minimum(this, last), before_last)
        most = np.maximum(np.maximum(this, last), before_last)
        is_large = least >= patience.cycles
        is_same = most - least <= patience.same * least
        rises = (this > last) & (last > before_last)
        falls = (this < last) & (last < before_last)
        next_block = np.full_like(this, np.inf)
        self._swings[:, flying] = next_block, this, last
        return np.asarray((is_large & is_same & ~rises & ~falls).any(axis=1))


def _has_left(
    lows: np.ndarray, highs: np.ndarray, least: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """Return a mask (F,) of the flights whose extremes in a window are not within the limits.

    Values that are not numbers are ignored here; a flight with them ends with such a value.

    lows, highs: lowest and highest states of each step, (F, T, n)
    least, most: limits, (F, n)
    """
    lowest = np.fmin.reduce(lows, axis=1)
    highest = np.fmax.reduce(highs, axis=1)
    is_inside = is_within(lowest, least, most) & is_within(highest, least, most)
    return np.asarray(~is_inside)
