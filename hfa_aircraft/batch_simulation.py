"""Simulation of many closed loops with held inputs, its step, cost and end."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import reduce
from typing import Any, NamedTuple, Protocol, TypeVar

import casadi as ca
import numpy as np

from hfa_support.matrices import quadratic_forms
from hfa_support.reporting.text import percent


def rk4(rate: Callable[[Any, float], Any], x: Any, h: Any) -> Any:
    """Return x after a step of h seconds by the classical Runge-Kutta method of order 4.

    rate: (x, c) -> x' at the fraction c of the step, 0, 0.5 or 1
    x: state before the step, as array or CasADi expression

    The order of operations is fixed, because stored flights are equal bit for bit. Source: Hairer,
    Norsett, Wanner, Solving Ordinary Differential Equations I, Table II.1.2.
    """
    k1 = rate(x, 0.0)
    k2 = rate(x + h / 2 * k1, 0.5)
    k3 = rate(x + h / 2 * k2, 0.5)
    k4 = rate(x + h * k3, 1.0)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


class Stepper(Protocol):
    """Advances flights by one tick of several integration steps.

    step: integration step, s
    steps: number of steps in a tick
    """

    step: float
    steps: int

    def __call__(self, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the states after each step, (N, steps, n), which the next call may overwrite.

        state: states at the start of the tick, (N, n)
        held: inputs held during the tick, (N, h)
        """


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
    """Loop and stepper of many flights x' = f(x) without inputs, by Runge-Kutta steps in NumPy.

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
        self.stepper: Stepper = self
        self.step = step
        self.steps = steps
        self._rate = rate
        self._starts = starts

    def start(self) -> np.ndarray:
        """Return the initial states, (N, n)."""
        return self._starts

    def hold(self, tick: int, state: np.ndarray, flying: np.ndarray) -> np.ndarray:
        """Return an array (F, 0)."""
        return state[:, :0]

    def __call__(self, state: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Return the states after each step, (N, steps, n)."""
        after = np.empty((len(state), self.steps, state.shape[1]))
        for number in range(self.steps):
            state = rk4(lambda x, _: self._rate(x), state, self.step)
            after[:, number] = state
        return after


#: Function from the time history of a window to a mask (N, T) or (N, T + 1), True where a flight is
#: over.
Over = Callable[[History], np.ndarray]


def simulate_batch(
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
            row = tick * steps - begin  # of the state at the beginning of the tick
            after = loop.stepper(state, loop.hold(tick, state, flying))
            in_window[:, row + 1 : row + steps + 1] = after
            state = after[:, -1]
        if over is not None:
            mask = over(History(begin, in_window, flying))
            is_over = mask.any(axis=1)
            first_over = begin + mask[is_over].argmax(axis=1)  # number of the first True step
            # A flight ends with its tick, in which its inputs are held.
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


#: Relative change of the figures with half the step below which a simulation is resolved: reports
#: print three digits.
RESOLVED = 1e-3
#: Largest number of steps in place of one.
_MOST_PARTS = 8
#: Relative changes below this are rounding: 1e5 steps with ten roundings of 1e-16 each, ten times.
_ROUNDING = 1e-9

Simulation = TypeVar("Simulation")


class ReportedFigure(NamedTuple):
    """Value of a reported figure, and the smallest value to which its change is relative."""

    value: float
    least: float = 0.0


#: Name of a reported figure -> its value.
Figures = Mapping[str, ReportedFigure]


class IntegrationError(NamedTuple):
    """Largest relative change of the reported figures of a simulation with half its step.

    step: integration step, s
    change: the change, inf if only one of both simulations has the figure
    figure: name of the figure that changes most, or "" if none changes
    """

    step: float
    change: float
    figure: str

    @property
    def is_resolved(self) -> bool:
        """True if no figure changes by more than `RESOLVED`."""
        return self.change <= RESOLVED

    def text(self) -> str:
        """Return the integration error as a sentence."""
        half = f"half the integration step of {1e3 * self.step:.3g} ms"
        if not self.figure:
            return f"No reported figure changes with {half}."
        if self.is_resolved:
            return (
                f"With {half}, figures change by at most {percent(100.0 * self.change, up=True)}."
            )
        by = "is another" if math.isinf(self.change) else f"changes by {100.0 * self.change:.2g} %"
        return f"Not resolved: with {half}, {self.figure} {by}."


def resolved(
    simulate: Callable[[int], Simulation], figures: Callable[[Simulation], Figures], step: float
) -> tuple[Simulation, IntegrationError]:
    """Return a simulation whose figures hardly change with half its step, and its error.

    The step is halved until no figure changes by more than `RESOLVED`, at most to 1 / `_MOST_PARTS`
    of it. The result is then the last simulation but one.

    simulate: number of steps in place of one -> simulation
    figures: figures of a simulation
    step: integration step of simulate(1), s
    """
    parts = 1
    coarser = simulate(parts)
    while True:
        finer = simulate(2 * parts)
        figure, change = _largest_change(figures(coarser), figures(finer))
        if change <= RESOLVED or 2 * parts >= _MOST_PARTS:
            return coarser, IntegrationError(step / parts, change, figure)
        coarser = finer
        parts *= 2


def _largest_change(before: Figures, after: Figures) -> tuple[str, float]:
    """Return the figure that changes most, "" if none does, and its relative change."""
    changed_most, largest = "", _ROUNDING
    for name in {**before, **after}:
        change = math.inf
        if name in before and name in after:
            # Each figure is a value, and the least magnitude to which its change is relative.
            (old, _), (new, least) = before[name], after[name]
            change = abs(new - old) / max(abs(new), least)
        if not change <= largest:  # also of a nan
            changed_most = name
            largest = change if math.isfinite(change) else math.inf
    return changed_most, largest if changed_most else 0.0


#: Nominal values by which a state deviates from the trim when a flight diverges.
FAR = 1e4
#: A bound on the cost-to-go V* in a box is exceeded by this factor when a flight diverges.
FAR_OF_VALUE = 1e12
#: A flight about an expansion leaves its neighborhood if z'Pz exceeds this multiple of its initial
#: value.
FAR_OF_EXPANSION = 100.0
#: A flight converges if its cost-to-go at the end is at most this fraction of its initial
#: cost-to-go. For critics that are not quadratic, the cost beyond is that of their linear part, and
#: costs are printed with three digits; for flights about an expansion, V is the cost beyond.
OF_VALUE = 1e-6
OF_EXPANSION = 1e-2


class FlightOutcome(StrEnum):
    """Outcome of a flight."""

    CONVERGED = "converges"
    LEFT = "leaves the envelope"
    UNDECIDED = "does not converge"


def is_within(states: Any, least: Any, most: Any) -> Any:
    """Return whether all states are finite numbers within limits.

    The result is a mask (N,) for arrays, and an expression for CasADi columns.

    states, least, most: (N, n), or columns (n,)
    """
    if isinstance(states, np.ndarray):
        return (np.isfinite(states) & (states >= least) & (states <= most)).all(axis=-1)
    limits = zip(*map(ca.vertsplit, (least, states, most)), strict=True)
    inside: list[Any] = [ca.logic_and(low <= x, x <= high) for low, x, high in limits]
    # An infinite state is within the limits ±inf.
    return ca.logic_and(all_finite(states), reduce(ca.logic_and, inside))


def all_finite(column: Any) -> Any:
    """Return the expression that all entries of a CasADi column are finite numbers."""
    # Comparisons with nan are false.
    finite: list[Any] = [ca.fabs(x) <= sys.float_info.max for x in ca.vertsplit(column)]
    return reduce(ca.logic_and, finite)


def has_decayed(value: Any, reference: Any, fraction: float) -> Any:
    """Return whether flights have converged, measured by a cost-to-go such as z'Pz.

    The cost-to-go at the end is at most a fraction of a reference, which must be finite. The result
    is a mask (N,) for arrays.

    value: cost-to-go at the end of each flight
    reference: cost-to-go at its start, or its cost
    """
    return np.isfinite(reference) & (value <= fraction * reference)


@dataclass(frozen=True, eq=False)
class Cost:
    """Cost ∫ z'Qz + 2z'Nv + v'Rv dt of the deviations of states z and inputs v.

    Q: (k, k)
    R: (m, m)
    N: (k, m), or None for 0
    """

    Q: np.ndarray
    R: np.ndarray
    N: np.ndarray | None = None

    def rate(self, z: Any, v: Any) -> Any:
        """Return the running cost z'Qz + 2z'Nv + v'Rv.

        As the rate of a further state, it is integrated with the order of the simulation.

        z, v: CasADi columns, or arrays (N, k) and (N, m). The result is then an array (N,)
        """
        if isinstance(z, np.ndarray):
            crossed = 0.0 if self.N is None else 2.0 * np.einsum("ij,jk,ik->i", z, self.N, v)
            return quadratic_forms(z, self.Q) + crossed + quadratic_forms(v, self.R)
        cost_rate = ca.bilin(ca.DM(self.Q), z, z)
        if self.N is not None:
            cost_rate += 2 * ca.dot(z, ca.DM(self.N) @ v)
        return cost_rate + ca.bilin(ca.DM(self.R), v, v)
