"""Pictures of nonlinear flights and of recoverable sets; draws, computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.envelope import ALPHA, ANGLE_OF_ATTACK, flown_through_air, limits_text
from controller.flight.gusts import UPDRAFT
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values
from trim.point.operating_point import at_scheduled
from verification.flights.recoverable_map import RecoverableMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: One color a state, in the order of the states of the HFA, the same in every map.
_COLORS = ("C0", "C1", "C7", "C4", "C3", "C2", "C5", "C6", "C8", "C9")
_PALE = 0.3
#: One gray an input that exceeds its limits.
_GRAYS = ("0.95", "0.5", "0.65", "0.78", "0.9")
#: A legend beside no curve: on the upper edge of its axes.
_ABOVE: dict[str, Any] = {"bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.0}
_SMALL: dict[str, Any] = {"loc": "right", "fontsize": 6, "pad": 2}


def flight_figure(result: NonlinearFlight, title: str) -> Figure:
    """Every state, absolute: nonlinear, linear prediction, reference; the inputs, a panel a unit;
    the updraft if there is one.

    Where the air moves, alpha through it besides.
    """
    model, times = result.point.model, result.flight.times
    kinds = list(dict.fromkeys(each.unit for each in model.inputs.values()))
    rows = -(-(len(model.states) + len(kinds) + 1) // 2)
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
        limited, what = result.states[:, index], name
        if name == ALPHA and result.flight.winds and flown_through_air(model):
            limited, what = result.angles_of_attack, "alpha over ground"
            axes.plot(
                times, shown_values(limited, unit), color="C2", linewidth=1.2, label=ANGLE_OF_ATTACK
            )
            axes.legend([axes.lines[-1]], [ANGLE_OF_ATTACK], fontsize=6, loc="lower left", **_ABOVE)
        limits = result.envelope.lowest[index], result.envelope.highest[index]
        _limit_lines(axes, limited, limits, unit)
        axes.set_title(f"envelope: {limits_text(*limits, unit)}", **_SMALL)
        _finish(axes, f"{what}, {shown_unit(unit)}")
    inputs, (air, *unused) = (
        panels[len(model.states) :][: len(kinds)],
        panels[len(model.states) + len(kinds) :],
    )
    for index, (name, signal) in enumerate(model.inputs.items()):
        axes, unit, limits = inputs[kinds.index(signal.unit)], signal.unit, (signal.min, signal.max)
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
    if np.any(result.flight.updrafts):
        unit = model.unit(UPDRAFT)
        air.plot(times, shown_values(result.flight.updrafts, unit), color="C2")
        _finish(air, f"updraft, {shown_unit(unit)}")
        figure.legend(
            handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, title=title
        )
    else:  # the legend takes the place of the updraft
        figure.suptitle(title, fontsize=10)
        air.set_axis_off()
        air.legend(handles, labels, loc="center", fontsize=9, title="still air")
    for axes in unused:
        axes.set_axis_off()
    for axes in panels[-2:]:
        axes.set_xlabel("time, s", fontsize=8)
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


def map_figure(maps: tuple[RecoverableMap, ...], title: str) -> Figure:
    """One column a set of equations: what becomes of the starts."""
    figure = new_figure(5.2 * len(maps), 5.6)
    panels = figure.subplots(1, len(maps), squeeze=False)
    handles: dict[str, Any] = {}
    for column, each in enumerate(maps):
        handles |= _start_map(panels[0, column], each)
    figure.legend(
        handles=list(handles.values()), loc="outside upper center", ncols=3, fontsize=8, title=title
    )
    return figure


def _start_map(axes: Axes, each: RecoverableMap) -> dict[str, Any]:
    """Label -> its mark in the legend."""
    from matplotlib.colors import to_rgb
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found, model = each.starts["nonlinear"], each.envelope.model
    states, inputs = tuple(model.states), tuple(model.inputs)
    inside, returned, left, exceeded = (
        found[name] for name in ("held", "returned", "left_first", "exceeded")
    )
    picture = np.ones((*inside.shape, 3))
    handles: dict[str, Any] = {}

    def fill(where: np.ndarray, color: Any, label: str) -> None:
        picture[where] = to_rgb(color)
        handles[label] = Patch(facecolor=color, edgecolor="gray", label=label)

    fill(found["within_limits"], "white", "stayed within limits")
    for index in np.unique(exceeded[inside & (exceeded >= 0)]).tolist():
        label = f"{inputs[index]} exceeded its limits, inside the envelope"
        fill(inside & (exceeded == index), _GRAYS[index % len(_GRAYS)], label)
    for index, back in sorted(
        set(zip(left[~inside].tolist(), returned[~inside].tolist(), strict=True))
    ):
        name = (*states, "no state")[index]
        label = f"came back, {name} had left" if back else f"lost, {name} left first"
        color = np.array(to_rgb("0.6" if index < 0 else _COLORS[index % len(_COLORS)]))
        fill(
            ~inside & (left == index) & (returned == back),
            _PALE * color + 1 - _PALE if back else color,
            label,
        )
    across, down = (shown_values(values, model.unit(name)) for name, values in each.axes.items())
    axes.pcolormesh(across, down, picture, shading="nearest")
    linear = each.starts["linear"]["held"].astype(float)
    if min(linear.shape) > 1 and 0.0 < linear.mean() < 1.0:
        axes.contour(
            across, down, linear, levels=[0.5], colors="black", linestyles="--", linewidths=1.2
        )
    label = "linear model inside the envelope"
    handles[label] = Line2D([], [], color="black", linestyle="--", label=label)
    axes.plot(0, 0, "+", color="black")
    along, up = (f"initial {name} off trim, {shown_unit(model.unit(name))}" for name in each.axes)
    axes.set_xlabel(along)
    axes.set_ylabel(up)
    axes.set_title(f"{each.point.called}, trim {at_scheduled(each.point)}", fontsize=10)
    return handles


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False)
    axes.grid(alpha=0.3)
