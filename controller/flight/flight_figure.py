"""The picture of a nonlinear flight; draws, computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.air import ALPHA, ANGLE_OF_ATTACK, UPDRAFT, flown_through_air
from controller.flight.envelope import limits_text
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A legend beside no curve: on the upper edge of its axes.
_ABOVE: dict[str, Any] = {"bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.0}
_SMALL: dict[str, Any] = {"loc": "right", "fontsize": 6, "pad": 2}


def flight_figure(result: NonlinearFlight, title: str) -> Figure:
    """Every state, absolute: nonlinear, linear prediction, reference; the inputs, a panel a unit;
    the updraft if there is one.

    Where the air moves, alpha through it besides.
    """
    model = result.point.model
    times = result.flight.times
    kinds = list(dict.fromkeys(each.unit for each in model.inputs.values()))
    gust = bool(np.any(result.flight.updrafts))
    count = len(model.states) + len(kinds) + int(gust)
    rows = -(-count // 2)
    figure = new_figure(10.0, 2.1 * rows)
    panels = figure.subplots(rows, 2, sharex=True).ravel()
    for index, (name, axes) in enumerate(zip(model.states, panels, strict=False)):
        unit = model.unit(name)
        if name in model.linear:
            row = model.linear.index(name)
            reference = result.states[:, index] - result.flight.errors[:, row]
            axes.plot(
                times,
                shown_values(reference, unit),
                ":",
                color="black",
                linewidth=1.0,
                label="reference",
            )
        if result.predicted is not None:
            predicted = result.predicted.states[:, index] + result.point.states[index]
            axes.plot(
                result.predicted.times,
                shown_values(predicted, unit),
                "--",
                color="C1",
                label="linear",
            )
        axes.plot(
            times,
            shown_values(result.states[:, index], unit),
            color="C0",
            linewidth=1.2,
            label="nonlinear",
        )
        limited = result.states[:, index]
        what = name
        if name == ALPHA and result.flight.winds and flown_through_air(model):
            limited = result.angles_of_attack
            what = "alpha over ground"
            axes.plot(
                times, shown_values(limited, unit), color="C2", linewidth=1.2, label=ANGLE_OF_ATTACK
            )
            axes.legend([axes.lines[-1]], [ANGLE_OF_ATTACK], fontsize=6, loc="lower left", **_ABOVE)
        limits = float(result.envelope.lowest[index]), float(result.envelope.highest[index])
        _limit_lines(axes, limited, limits, unit)
        axes.set_title(f"envelope: {limits_text(*limits, unit)}", **_SMALL)
        _finish(axes, f"{what}, {shown_unit(unit)}")
    inputs = panels[len(model.states) :][: len(kinds)]
    for index, (name, signal) in enumerate(model.inputs.items()):
        axes = inputs[kinds.index(signal.unit)]
        unit = signal.unit
        limits = (signal.min, signal.max)
        label = f"{name}: {limits_text(*limits, unit)}"
        axes.plot(times, shown_values(result.inputs[:, index], unit), label=label, linewidth=1.0)
        _limit_lines(axes, result.inputs[:, index], limits, unit)
    for axes, unit in zip(inputs, kinds, strict=True):
        names = [name for name, signal in model.inputs.items() if signal.unit == unit]
        label = names[0] if len(names) == 1 else "deflections" if unit == "rad" else "inputs"
        label += "" if unit == "1" else f", {shown_unit(unit)}"
        axes.legend(loc="lower left", fontsize=6, ncols=2, **_ABOVE)
        _finish(axes, label)
    handles, labels = panels[0].get_legend_handles_labels()
    if gust:
        air = panels[count - 1]
        unit = model.unit(UPDRAFT)
        air.plot(times, shown_values(result.flight.updrafts, unit), color="C2")
        _finish(air, f"updraft, {shown_unit(unit)}")
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, title=title
    )
    for axes in panels[count:]:
        axes.set_axis_off()
    for axes in panels[count - 2 : count]:
        axes.set_xlabel("time, s", fontsize=8)
        axes.tick_params(labelbottom=True)
    return figure


def _limit_lines(axes: Axes, limited: np.ndarray, limits: tuple[float, float], unit: str) -> None:
    """The limits where what they limit, (N,), came near them."""
    lowest, highest = limits
    for limit, near in (
        (lowest, limited.min() < lowest + 0.2 * (highest - lowest)),
        (highest, limited.max() > highest - 0.2 * (highest - lowest)),
    ):
        if near:
            axes.axhline(
                float(shown_values(limit, unit)), color="black", linestyle="--", linewidth=0.8
            )


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False)
    axes.grid(alpha=0.3)
