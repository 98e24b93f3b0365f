"""Simulation of a closed loop, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import RowSteps, Stepper
from hfa_support.progress import Progress


class Loop(Protocol):
    """A closed loop that can be simulated: a plant and what holds its inputs.

    stepper: integration of the plant over a tick, during which the inputs are held
    """

    stepper: Stepper

    def start(self) -> np.ndarray:
        """Return the initial states of all flights, (N, n)."""

    def hold(self, tick: int, time: float, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the inputs that are held during a tick, (F, h).

        tick: number of the tick
        time: start of the tick, s
        state: states of the F flights that are not over, (F, n)
        flying: numbers of these flights, (F,)
        """


@dataclass(frozen=True, eq=False)
class History:
    """Time history of N flights.

    step: integration step, s
    first: number of the first of T steps
    states: (N, T, n). A history of a window also has the states at its end, (N, T + 1, n)
    seen: observed values, (N, T, k)
    flights: numbers of the flights, (N,)
    """

    step: float
    first: int
    states: np.ndarray
    seen: np.ndarray
    flights: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Times of the steps, s, (T,)."""
        return self.step * np.arange(self.first, self.first + self.states.shape[1])


def saturated(value: Any, lowest: Any, highest: Any) -> Any:
    """Return an expression limited to lowest and highest, such as a command to the inputs' limits.

    lowest, highest: numbers, arrays or expressions
    """
    return ca.fmin(ca.fmax(value, lowest), highest)


class Rows:
    """Loop of many flights x' = f(x, u), by Runge-Kutta steps.

    rate: (states (N, n), inputs (N, h)) -> x', (N, n)
    starts: initial states, (N, n)
    step: s
    policy: (states (N, n), numbers of these flights) -> inputs held during a tick, (N, h), or None
        without inputs
    steps: number of steps in a tick
    """

    def __init__(
        self,
        rate: Callable[[np.ndarray, np.ndarray], np.ndarray],
        starts: np.ndarray,
        step: float,
        policy: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None,
        steps: int = 1,
    ) -> None:
        self.stepper: Stepper = RowSteps(rate, starts.shape[1], step, steps)
        self._starts = starts
        self._policy = policy

    def start(self) -> np.ndarray:
        """Return the initial states, (N, n)."""
        return self._starts

    def hold(self, tick: int, time: float, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the inputs during a tick, (F, h)."""
        return state[:, :0] if self._policy is None else self._policy(state, flying)


#: Function from the time history of a window to a mask (N, T) or (N, T + 1), True where a flight is
#: over.
Over = Callable[[History], np.ndarray]


def march(
    loop: Loop,
    ticks: int,
    *,
    over: Over | None = None,
    window: int = 1,
    keep: bool = True,
    progress: Progress | None = None,
) -> tuple[History, np.ndarray]:
    """Simulate flights, each until it is over.

    Returns the time history of all flights, and the number of the step at which each flight ends,
    (N,). This step is the end of the tick in which `over` is True first. The history after it is
    undefined. Without `keep`, the history contains only the final state of each flight.

    ticks: largest number of ticks, at least 1
    over: decides which flights are over, or None for flights of all ticks
    window: number of ticks after which `over` and `progress` are called
    keep: whether the states and observed values of all steps are returned
    """
    stepper = loop.stepper
    step = stepper.step
    steps = stepper.steps
    n, k = stepper.sizes
    state = loop.start()
    flying = np.arange(len(state))
    ends = np.full(len(state), ticks * steps)
    # Memory is allocated only for the rows that are written.
    kept = ticks * steps + 1 if keep else 1
    states = np.empty((len(state), kept, n))
    seen = np.empty((len(state), kept, k))
    states[:, 0] = state
    for first in range(0, ticks, window):
        last = min(first + window, ticks)
        begin = first * steps
        end = last * steps
        flown = np.empty((len(flying), end - begin + 1, n))
        observed = np.empty((len(flying), end - begin, k))
        flown[:, 0] = state
        for tick in range(first, last):
            row = tick * steps - begin
            time = tick * steps * step
            held = loop.hold(tick, time, state, flying)
            after, before = stepper(time, state, held)
            flown[:, row + 1 : row + steps + 1] = after
            observed[:, row : row + steps] = before
            state = after[:, -1]
        if over is not None:
            mask = over(History(step, begin, flown, observed, flying))
            is_over = mask.any(axis=1)
            first_over = begin + mask[is_over].argmax(axis=1)
            ends[flying[is_over]] = steps * np.ceil(first_over / steps).astype(int)
        if keep:
            states[flying, begin : end + 1] = flown
            seen[flying, begin:end] = observed
            if np.any(ends[flying] == end):  # the values observed at the end are still missing
                seen[flying, end] = stepper.observed(end * step, state, held)
        else:
            last_rows = np.minimum(ends[flying], end) - begin
            states[flying, 0] = flown[np.arange(len(flying)), last_rows]
        is_flying = ends[flying] > end
        flying, state = flying[is_flying], state[is_flying]
        if progress is not None:
            progress(last if flying.size else ticks, ticks)
        if not flying.size:
            break
    return History(step, 0, states, seen, np.arange(len(states))), ends
