"""Figure of flights over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.simulate.envelope import envelope_data, limits_text
from hfa_support.reporting.text import beside_unit, shown_values, wrapped

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
#: A signal is constant if it changes by less than this fraction of its nominal size.
_STILL = 1e-9
#: Least range of a panel, as a fraction of the nominal size. It hides rounding errors.
_LEAST_RANGE = 0.02
#: Margin around the curves in a panel, relative to their range.
_MARGIN = 0.25


class Curve(NamedTuple):
    """Flight in a figure.

    label: text in the legend
    style: color and line
    times: (N,), s
    values: signal -> absolute values, (N,)
    is_whole: whether the panels show its whole range
    """

    label: str
    style: str
    times: np.ndarray
    values: Mapping[str, np.ndarray]
    is_whole: bool = True


def histories_of(model: Model, states: np.ndarray, inputs: np.ndarray) -> dict[str, np.ndarray]:
    """Return signal -> values (N,) of a flight.

    states, inputs: absolute, (N, n) and (N, m)
    """
    return dict(zip((*model.states, *model.inputs), (*states.T, *inputs.T), strict=True))


def flight_figure(figure: Figure, envelope: Limits, curves: Sequence[Curve], title: str) -> Figure:
    """Draw a panel for each signal that moves, with its limits, and return the figure.

    figure: the figure, without axes
    envelope: limits of the states and outputs
    curves: the flights, each with some of the signals
    title: title of the legend
    """
    model = in_gusts(envelope.model)
    names = tuple(dict.fromkeys(name for curve in curves for name in curve.values))
    # If no signal moves, all are drawn.
    moving = [
        name
        for name in names
        if np.ptp(_range(name, curves)) > _STILL * model.signals[name].nominal
    ] or names
    limits = {name: [signal.min, signal.max] for name, signal in model.inputs.items()}
    limits |= envelope_data(envelope)
    rows = math.ceil(len(moving) / _COLUMNS)
    figure.set_size_inches(10.0, 1.2 + 1.7 * rows)
    panels = figure.subplots(rows, _COLUMNS, sharex=True, squeeze=False).ravel()
    handles = {}
    for name, axes in zip(moving, panels, strict=False):
        _draw(axes, model, name, curves, limits.get(name, [-np.inf, np.inf]))
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles[label] = handle
    for axes in panels[len(moving) :]:
        axes.set_axis_off()
    for axes in panels[max(0, len(moving) - _COLUMNS) : len(moving)]:
        axes.set_xlabel("time, s", fontsize=8)
        axes.tick_params(labelbottom=True)
    constant = ", ".join(name for name in names if name not in moving)
    title += f"\nconstant: {constant}" if constant else ""
    figure.legend(
        [*handles.values()],
        [*handles],
        loc="outside upper center",
        ncols=min(4, len(handles)),
        fontsize=8,
        title=wrapped(title, 120),
    )
    return figure


def _range(name: str, curves: Sequence[Curve]) -> tuple[float, float]:
    """Return the least and the largest value of a signal in the curves that are shown whole."""
    values = [curve.values[name] for curve in curves if curve.is_whole and name in curve.values]
    known = np.concatenate(values)
    known = known[np.isfinite(known)]
    return float(known.min()), float(known.max())


def _draw(
    axes: Axes, model: Model, name: str, curves: Sequence[Curve], limits: Sequence[float]
) -> None:
    """Draw one signal of all curves and its limits in a panel."""
    unit = model.unit(name)
    for curve in curves:
        if name in curve.values:
            values = shown_values(curve.values[name], unit)
            axes.plot(curve.times, values, curve.style, linewidth=1.1, label=curve.label)
    low, high = _range(name, curves)
    least_range = _LEAST_RANGE * model.signals[name].nominal
    margin = max(_MARGIN * (high - low), (least_range - (high - low)) / 2.0)
    low, high = shown_values(np.array([low - margin, high + margin]), unit).tolist()
    axes.set_ylim(low, high)
    for limit in shown_values(np.array(limits), unit):
        if low < limit < high:
            axes.axhline(float(limit), color="black", linestyle="--", linewidth=0.8, label="limit")
    if np.isfinite(limits).any():
        text = f"limits: {beside_unit(limits_text(limits[0], limits[1], unit), unit)}"
        axes.set_title(text, loc="right", fontsize=6, pad=2)
    axes.set_ylabel(beside_unit(name, unit, ", "), fontsize=8)
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False)
    axes.grid(alpha=0.3)
