"""Simulation of a closed loop, tick by tick."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import casadi as ca
import numpy as np

from hfa_aircraft.march.steppers import RowSteps, Stepper


class Loop(Protocol):
    """A closed loop that can be simulated: a plant and what holds its inputs.

    stepper: integration of the plant over a tick, during which the inputs are held
    """

    stepper: Stepper

    def start(self) -> np.ndarray:
        """Return the initial states of all flights, (N, n)."""

    def hold(self, tick: int, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return the inputs that are held during a tick, (F, h).

        tick: number of the tick
        state: states of the F flights that are not over, (F, n)
        flying: numbers of these flights, (F,)
        """


@dataclass(frozen=True, eq=False)
class History:
    """Time history of N flights.

    first: number of the first of T steps
    states: (N, T, n). A history of a window also has the states at its end, (N, T + 1, n)
    flights: numbers of the flights, (N,)
    """

    first: int
    states: np.ndarray
    flights: np.ndarray


def saturated(value: Any, lowest: Any, highest: Any) -> Any:
    """Return an expression limited to lowest and highest, such as a command to the inputs' limits.

    lowest, highest: numbers, arrays or expressions
    """
    return ca.fmin(ca.fmax(value, lowest), highest)


class Rows:
    """Loop of many flights x' = f(x) without inputs, by Runge-Kutta steps.

    rate: states (N, n) -> x', (N, n)
    starts: initial states, (N, n)
    step: s
    steps: number of steps in a tick
    """

    def __init__(
        self,
        rate: Callable[[np.ndarray], np.ndarray],
        starts: np.ndarray,
        step: float,
        steps: int,
    ) -> None:
        self.stepper: Stepper = RowSteps(rate, step, steps)
        self._starts = starts

    def start(self) -> np.ndarray:
        """Return the initial states, (N, n)."""
        return self._starts

    def hold(self, tick: int, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return an array (F, 0)."""
        return state[:, :0]


#: Function from the time history of a window to a mask (N, T) or (N, T + 1), True where a flight is
#: over.
Over = Callable[[History], np.ndarray]


def march(
    loop: Loop,
    ticks: int,
    *,
    over: Over | None,
    keep: bool,
    window: int = 1,
) -> tuple[History, np.ndarray]:
    """Simulate flights, each until it is over.

    Returns the time history of all flights, and the number of the step at which each flight ends,
    (N,). This step is the end of the tick in which `over` is True first. The history after it is
    undefined. Without `keep`, the history contains only the final state of each flight.

    ticks: largest number of ticks, at least 1
    over: decides which flights are over, or None for flights of all ticks
    keep: whether the states of all steps are returned
    window: number of ticks after which `over` is called
    """
    steps = loop.stepper.steps
    state = loop.start()
    n = state.shape[1]
    flying = np.arange(len(state))  # numbers of the flights that are not over
    ends = np.full(len(state), ticks * steps)
    # Memory is allocated only for the rows that are written.
    kept_rows = ticks * steps + 1 if keep else 1
    kept = np.empty((len(state), kept_rows, n))
    kept[:, 0] = state
    for first_tick in range(0, ticks, window):
        last_tick = min(first_tick + window, ticks)
        begin = first_tick * steps
        end = last_tick * steps
        in_window = np.empty((len(flying), end - begin + 1, n))
        in_window[:, 0] = state
        for tick in range(first_tick, last_tick):
            row = tick * steps - begin
            after = loop.stepper(state, loop.hold(tick, state, flying))
            in_window[:, row + 1 : row + steps + 1] = after
            state = after[:, -1]
        if over is not None:
            mask = over(History(begin, in_window, flying))
            is_over = mask.any(axis=1)
            first_over = begin + mask[is_over].argmax(axis=1)
            ends[flying[is_over]] = steps * np.ceil(first_over / steps).astype(int)
        if keep:
            kept[flying, begin : end + 1] = in_window
        else:
            last_rows = np.minimum(ends[flying], end) - begin
            kept[flying, 0] = in_window[np.arange(len(flying)), last_rows]
        is_flying = ends[flying] > end
        flying, state = flying[is_flying], state[is_flying]
        if not flying.size:
            break
    return History(0, kept, np.arange(len(kept))), ends
