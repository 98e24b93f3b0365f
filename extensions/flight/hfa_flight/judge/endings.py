"""Ends of flights of a deployed policy, decided window by window: convergence, departures."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hfa_aircraft.batch_simulation import History, Outcome, is_within

#: Half-widths of the ball within which a flight has converged, in half-widths of the
#: initial-condition box.
BALL = 0.05
#: Function from states (..., s) to the lowest and the highest states of a step, (..., n) each.
Extremes = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
#: A flight about an unstable equilibrium leaves it in the end. It has converged only if its
#: distance has not grown by the factor `_GROWN` in the last `_GROWTH` windows.
_GROWTH = 10
_GROWN = 1.02


class Endings:
    """How N flights end, decided window by window while `march` simulates them.

    A flight ends with the window in which it leaves the limits, or a state is not a number. A
    flight of the full duration converges if it ends in the ball, and its distance does not grow
    about an unstable equilibrium.

    outcomes: `Outcome` of each flight, (N,)
    nearest: distance of each flight in its last window, (N,)
    left_at: number of the step at which each flight left the limits, (N,)
    left_with: states at this step, (N, n)
    """

    def __init__(
        self,
        limits: tuple[np.ndarray, np.ndarray],
        distance: Callable[[History], np.ndarray],
        windows: int,
        *,
        stable: np.ndarray,
        extremes: Extremes,
    ) -> None:
        """Begin with N undecided flights.

        limits: least and most value of each state, (N, n) each
        distance: largest distance of each flight from its equilibrium in a window, in half-widths
            of the ball, inf without an equilibrium
        windows: number of windows in the full duration
        stable: True for flights about a stable equilibrium, (N,)
        extremes: function from the states of a history to the lowest and the highest states of
            each step, which must be within the limits
        """
        count, n = limits[0].shape
        self.outcomes = np.full(count, Outcome.UNDECIDED, dtype=object)
        self.nearest = np.full(count, np.inf)
        self.left_at = np.zeros(count, dtype=int)
        self.left_with = np.full((count, n), np.nan)
        self._least, self._most = limits
        self._distance = distance
        self._windows = windows
        self._stable = stable
        self._extremes = extremes
        self._earlier = np.full(count, np.inf)

    def over(self, flown: History) -> np.ndarray:
        """Return a mask (F, T + 1), True at the end of a window in which a flight ends."""
        flying = flown.flights
        window = flown.first // (flown.states.shape[1] - 1)
        if window == self._windows - _GROWTH:
            self._earlier[flying] = self.nearest[flying]
        self.nearest[flying] = self._distance(flown)
        left = self._mark_departures(flown)
        self.outcomes[flying[left]] = Outcome.LEFT
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        mask[:, -1] = left
        return mask

    def close(self) -> None:
        """Decide the flights of the full duration: those that end in the ball have converged."""
        grows = self.nearest > _GROWN * self._earlier
        in_ball = (self.nearest <= 1.0) & (self._stable | ~grows)
        self.outcomes[(self.outcomes == Outcome.UNDECIDED) & in_ball] = Outcome.CONVERGED

    def _mark_departures(self, flown: History) -> np.ndarray:
        """Return a mask of the flights that left their limits, and store when and with what.

        A flight leaves with the first step whose extremes are not all within its limits, or whose
        last states are not all finite. Extremes ignore values that are not numbers.
        """
        flights = flown.flights
        states = flown.states[:, :, : self._least.shape[1]]  # the first ones have limits
        lowest_each_step, highest_each_step = self._extremes(flown.states)
        least, most = self._least[flights], self._most[flights]
        left = _has_left(lowest_each_step, highest_each_step, least, most)
        left |= ~np.isfinite(states[:, -1]).all(axis=1)
        for row in np.flatnonzero(left):
            low, high = lowest_each_step[row], highest_each_step[row]
            within = is_within(low, least[row], most[row]) & is_within(high, least[row], most[row])
            step = int((within & np.isfinite(states[row]).all(axis=1)).argmin())
            flight = flights[row]
            self.left_at[flight] = flown.first + step
            # Of each state, the extreme that is beyond its limit, or the highest value.
            is_low = (low[step] < least[row]) | np.isneginf(low[step])
            extreme = np.where(is_low, low[step], high[step])
            self.left_with[flight] = states[row, step] if within[step] else extreme
        return np.asarray(left)


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
