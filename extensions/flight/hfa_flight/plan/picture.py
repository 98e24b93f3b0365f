"""Figure of several flights from the same initial condition."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.plan.flights import SimulatedFlight
from hfa_flight.plan.problem import FlightProblem
from hfa_flight.simulate.flight_figure import finished
from hfa_support.reporting.text import beside_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Margin around the signals in a panel, relative to their range.
_BEYOND = 0.3


def drawn(
    figure: Figure,
    problem: FlightProblem,
    flights: list[tuple[SimulatedFlight, str]],
    seconds: float,
    title: str,
) -> Figure:
    """Draw a panel for each linear state and each moving input, and return the figure.

    figure: the figure, without axes
    flights: pairs (flight, label), the best flight first
    seconds: end of the time axis, s
    title: title of the legend
    """
    names = [*problem.states, *problem.inputs]
    panels = figure.subplots(-(-len(names) // 3), 3, sharex=True).ravel()
    for name, axes in zip(names, panels, strict=False):
        _draw(axes, problem, name, flights)
        axes.set_xlim(0.0, seconds)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    for axes in panels[: len(names)]:
        axes.tick_params(labelbottom=True)
    for axes in panels[max(0, len(names) - 3) : len(names)]:
        axes.set_xlabel("time, s", fontsize=8)
    handles = {}
    for axes in panels:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles[label] = handle
    figure.legend(
        [*handles.values()],
        [*handles],
        loc="outside upper center",
        ncols=3,
        fontsize=8,
        title=title,
    )
    return figure


def _draw(
    axes: Axes, problem: FlightProblem, name: str, flights: list[tuple[SimulatedFlight, str]]
) -> None:
    """Draw one state or input of all flights and its limits in a panel.

    The axis shows the whole range of the first flight and of those that converge.
    """
    model = problem.model
    unit = model.unit(name)
    limits = model.limits[name]
    if name in problem.envelope.names:
        place = list(problem.envelope.names).index(name)
        limits = (problem.envelope.lowest[place], problem.envelope.highest[place])
    shown_whole = []
    for number, (flown, label) in enumerate(flights):
        values = shown_values(_column(model, flown, name), unit)
        style = "-" if number == 0 else "--"
        axes.plot(flown.times, values, style, color=f"C{number}", linewidth=1.1, label=label)
        if number == 0 or flown.converges:
            shown_whole.append(values)
    low = min(float(values.min()) for values in shown_whole)
    high = max(float(values.max()) for values in shown_whole)
    room = _BEYOND * max(high - low, 1e-9)
    axes.set_ylim(low - room, high + room)
    for limit in shown_values(np.array(limits), unit):
        if low - room < limit < high + room:
            axes.axhline(float(limit), color="black", linestyle=":", linewidth=0.8, label="limit")
    finished(axes, beside_unit(name, unit, ", "))


def _column(model: Model, flown: SimulatedFlight, name: str) -> np.ndarray:
    if name in model.states:
        return flown.states[:, list(model.states).index(name)]
    return flown.inputs[:, list(model.inputs).index(name)]
