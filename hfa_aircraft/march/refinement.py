"""Integration error of simulations, from simulations with half the step."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

from hfa_support.reporting.text import percent

#: Relative change of the figures with half the step below which a simulation is resolved: reports
#: print three digits.
RESOLVED = 1e-3
#: Largest number of steps in place of one.
_MOST = 8
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

    The step is halved until no figure changes by more than `RESOLVED`, at most to 1 / `_MOST`. The
    result is then the last simulation but one.

    simulate: number of steps in place of one -> simulation
    figures: figures of a simulation
    step: integration step of simulate(1), s
    """
    parts = 1
    flown = simulate(parts)
    while True:
        finer = simulate(2 * parts)
        figure, change = _largest_change(figures(flown), figures(finer))
        if change <= RESOLVED or 2 * parts >= _MOST:
            return flown, IntegrationError(step / parts, change, figure)
        flown = finer
        parts *= 2


def _largest_change(before: Figures, after: Figures) -> tuple[str, float]:
    """Return the figure that changes most, "" if none does, and its relative change."""
    changed_most, largest = "", _ROUNDING
    for name in {**before, **after}:
        change = math.inf
        if name in before and name in after:
            (old, _), (new, least) = before[name], after[name]
            change = abs(new - old) / max(abs(new), least)
        if not change <= largest:
            changed_most = name
            largest = change if math.isfinite(change) else math.inf  # a nan is a large change
    return changed_most, largest if changed_most else 0.0
