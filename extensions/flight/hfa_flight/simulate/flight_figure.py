"""Figure of a nonlinear flight over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.history import Deviations
from hfa_flight.air.names import ALPHA, ANGLE_OF_ATTACK, UPDRAFT, has_angle_of_attack
from hfa_flight.simulate.envelope import limits_text
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import beside_unit, shown_unit, shown_values
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Position of a legend on the upper edge of its axes, where it covers no curve.
_ABOVE: dict[str, Any] = {"bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.0}
_SMALL: dict[str, Any] = {"loc": "right", "fontsize": 6, "pad": 2}
#: A state is constant if it changes by less than this fraction of its nominal size.
_STILL = 1e-9
#: Group of the limit lines. The legend shows one of them.
_LIMIT = "limit"


class DrawnFlight(NamedTuple):
    """Flight that a figure shows, in deviations from a trim.

    point: the trim
    envelope: limits of the states
    flown: the flight
    predicted: flight of the linear model, or None
    """

    point: OperatingPoint
    envelope: Limits
    flown: Deviations
    predicted: Deviations | None


def flight_figure(flight: DrawnFlight, title: str, figure: Figure | None = None) -> Figure:
    """Draw a flight over time on an empty figure, by default a new one, and return it.

    There is a panel for each state that moves, a panel for the inputs of each unit, and a panel for
    the updraft if it is not zero.
    """
    figure = figure or new_figure(10.0, 2.1)
    model, flown = flight.point.model, flight.flown
    input_units = list(dict.fromkeys(signal.unit for signal in model.inputs.values()))
    updraft = flown.winds.get(UPDRAFT, np.zeros(0))
    has_updraft = bool(np.any(updraft))
    moving = [index for index in range(len(model.states)) if _moves(flight, index)]
    count = len(moving) + len(input_units) + int(has_updraft)
    rows = -(-count // 2)
    figure.set_size_inches(10.0, 2.1 * rows)
    panels = figure.subplots(rows, 2, sharex=True, squeeze=False).ravel()
    for index, axes in zip(moving, panels, strict=False):
        _draw_state(axes, flight, index)
    for unit, axes in zip(input_units, panels[len(moving) :], strict=False):
        _draw_inputs(axes, flight, unit)
    constant = [name for index, name in enumerate(model.states) if index not in moving]
    if constant:
        title += f"\nconstant: {', '.join(constant)}"
    if has_updraft:
        air = panels[count - 1]
        unit = in_gusts(model).unit(UPDRAFT)
        air.plot(flown.times, shown_values(updraft, unit), color="C2")
        finished(air, f"updraft, {shown_unit(unit)}")
    handles, labels = panels[0].get_legend_handles_labels()
    lines = [line for axes in panels for line in axes.get_lines()]
    limits = [line for line in lines if line.get_gid() == _LIMIT]
    if limits:
        handles.append(limits[0])
        labels.append(_LIMIT)
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, title=title
    )
    for axes in panels[count:]:
        axes.set_axis_off()
    for axes in panels[count - 2 : count]:
        axes.set_xlabel("time, s", fontsize=8)
        axes.tick_params(labelbottom=True)
    return figure


def _moves(flight: DrawnFlight, index: int) -> bool:
    """Return whether a state or its reference changes during the flight by more than rounding."""
    model = flight.point.model
    name = tuple(model.states)[index]
    values = flight.flown.states[:, index]
    if name in model.linear:
        values = np.append(values, values - flight.flown.errors[:, model.linear.index(name)])
    return bool(np.ptp(values) > _STILL * model.states[name].nominal)


def _widened(axes: Axes, nominal: float, unit: str) -> None:
    """Widen the vertical range of a panel to hide rounding errors."""
    low, high = axes.get_ylim()
    least = 0.02 * float(shown_values(nominal, unit))
    if high - low < least:
        middle = (low + high) / 2
        axes.set_ylim(middle - least / 2, middle + least / 2)


def _draw_state(axes: Axes, flight: DrawnFlight, index: int) -> None:
    """Draw one state over time in a panel, as absolute values."""
    model, trim = flight.point.model, flight.point.states[index]
    name = tuple(model.states)[index]
    unit = model.unit(name)
    times = flight.flown.times
    flown = flight.flown.states[:, index] + trim

    def draw(times: np.ndarray, values: np.ndarray, style: str, label: str, **more: Any) -> Any:
        return axes.plot(times, shown_values(values, unit), style, label=label, **more)

    if name in model.linear:
        reference = flown - flight.flown.errors[:, model.linear.index(name)]
        draw(times, reference, ":", "reference", color="black", linewidth=1.0)
    if flight.predicted is not None:
        predicted = flight.predicted.states[:, index] + trim
        draw(flight.predicted.times, predicted, "--", "linear", color="C1")
    draw(times, flown, "-", "nonlinear", color="C0", linewidth=1.2)
    limited, label = flown, name
    if name == ALPHA and flight.flown.winds and has_angle_of_attack(model):
        limited, label = flight.flown.limited[:, index] + trim, "alpha over ground"
        relative = draw(times, limited, "-", ANGLE_OF_ATTACK, color="C2", linewidth=1.2)
        axes.legend(relative, [ANGLE_OF_ATTACK], fontsize=6, loc="lower left", **_ABOVE)
    limits = (float(flight.envelope.lowest[index]), float(flight.envelope.highest[index]))
    _limit_lines(axes, limited, limits, unit)
    if np.isfinite(limits).any():
        axes.set_title(f"envelope: {_limits_with_unit(limits, unit)}", **_SMALL)
    _widened(axes, model.states[name].nominal, unit)
    finished(axes, beside_unit(label, unit, ", "))


def _draw_inputs(axes: Axes, flight: DrawnFlight, unit: str) -> None:
    """Draw all inputs that have one unit, and their limits, over time in a panel."""
    model, times = flight.point.model, flight.flown.times
    inputs = {name: each for name, each in model.inputs.items() if each.unit == unit}
    columns = dict(zip(model.inputs, (flight.flown.inputs + flight.point.u).T, strict=True))
    for name, signal in inputs.items():
        values, limits = columns[name], (signal.min, signal.max)
        shown = _limits_with_unit(limits, unit) if np.isfinite(limits).any() else "no limits"
        axes.plot(times, shown_values(values, unit), label=f"{name}: {shown}", linewidth=1.0)
        _limit_lines(axes, values, limits, unit)
    _widened(axes, max(signal.nominal for signal in inputs.values()), unit)
    if len(inputs) == 1:
        label = name
        axes.set_title(f"limits: {shown}", **_SMALL)
    else:
        label = "deflections" if unit == "rad" else "inputs"
        axes.legend(loc="lower left", fontsize=6, ncols=2, **_ABOVE)
    finished(axes, beside_unit(label, unit, ", "))


def _limits_with_unit(limits: tuple[float, float], unit: str) -> str:
    """Return limits with their unit, such as "-20 to 20 deg"."""
    return beside_unit(limits_text(*limits, unit), unit)


def _limit_lines(axes: Axes, limited: np.ndarray, limits: tuple[float, float], unit: str) -> None:
    """Draw each limit that the values approach within 20 % of the distance between the limits."""
    lowest, highest = limits
    for limit, near in (
        (lowest, limited.min() < lowest + 0.2 * (highest - lowest)),
        (highest, limited.max() > highest - 0.2 * (highest - lowest)),
    ):
        if near:
            level = float(shown_values(limit, unit))
            axes.axhline(level, color="black", linestyle="--", linewidth=0.8, gid=_LIMIT)


def finished(axes: Axes, label: str) -> None:
    """Set the label and the look of a panel."""
    axes.set_ylabel(label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False)
    axes.grid(alpha=0.3)
