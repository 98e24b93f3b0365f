"""Pictures of nonlinear flights and of recoverable sets; draws, computes nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.envelope import ANGLE_OF_ATTACK
from controller.flight.nonlinear_flight import NonlinearFlight
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, STATES
from hfa_support.reporting.figure import enlarge_first_second, new_figure
from hfa_support.reporting.text import shown_unit, shown_values
from trim.point.condition import CONTROL_LIMITS
from verification.flights.recoverable_map import RecoverableMap

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: One color a state, the same in every map.
COLORS = dict(zip(STATES, ("C0", "C1", "C7", "C4", "C3", "C2", "C5"), strict=True))
_PALE = 0.3
#: One gray an input that exceeds its limits.
_GRAYS = ("0.95", "0.5", "0.65", "0.78", "0.9")
#: A legend beside no curve: on the upper edge of its axes.
_ABOVE: dict[str, Any] = {"bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.0}
_SMALL: dict[str, Any] = {"loc": "right", "fontsize": 6, "pad": 2}
_DIHEDRAL = STATES.index("dihedral")


def flight_figure(result: NonlinearFlight, title: str) -> Figure:
    """The seven states, absolute: nonlinear, linear prediction, reference; the inputs; the updraft if there is one.

    Where the air moves, alpha through it besides.
    """
    figure = new_figure(10.0, 10.5)
    panels = figure.subplots(5, 2, sharex=True).ravel()
    times = result.flight.times
    for index, (name, axes) in enumerate(zip(STATES, panels, strict=False)):
        unit = getattr(STATE_UNITS, name)
        if name in LINEAR_STATES:
            row = LINEAR_STATES.index(name)
            reference = result.states[:, index] - result.flight.errors[:, row]
            axes.plot(times, shown_values(reference, unit), ":", color="black", linewidth=1.0, label="reference")
        if result.predicted is not None:
            predicted = result.predicted.states[:, index] + result.point.states[index]
            axes.plot(result.predicted.times, shown_values(predicted, unit), "--", color="C1", label="linear")
        axes.plot(times, shown_values(result.states[:, index], unit), color="C0", linewidth=1.2, label="nonlinear")
        limited, what = result.states[:, index], name
        if name == "alpha" and result.scenario.moving_air:
            limited, what = result.angles_of_attack, "alpha over ground"
            axes.plot(times, shown_values(limited, unit), color="C2", linewidth=1.2, label=ANGLE_OF_ATTACK)
            axes.legend([axes.lines[-1]], [ANGLE_OF_ATTACK], fontsize=6, loc="lower left", **_ABOVE)
        limits = result.envelope.lowest[index], result.envelope.highest[index]
        _limit_lines(axes, limited, limits, unit)
        axes.set_title(_limits_text("envelope", *limits, unit), **_SMALL)
        enlarge_first_second(axes)
        _finish(axes, f"{what}, {shown_unit(unit)}")
    throttle, surfaces, air = panels[len(STATES) :]
    for index, name in enumerate(INPUTS):
        axes, unit, limits = throttle if name == "throttle" else surfaces, INPUT_UNITS[index], CONTROL_LIMITS[index]
        label = _limits_text(name, limits[0], limits[1], unit)
        axes.plot(times, shown_values(result.inputs[:, index], unit), label=label, linewidth=1.0)
        _limit_lines(axes, result.inputs[:, index], limits, unit)
    for axes, label in ((throttle, "throttle"), (surfaces, "deflections, deg")):
        axes.legend(loc="lower left", fontsize=6, ncols=2, **_ABOVE)
        enlarge_first_second(axes)
        _finish(axes, label)
    handles, labels = panels[0].get_legend_handles_labels()
    if np.any(result.flight.updrafts):
        air.plot(times, shown_values(result.flight.updrafts, "ft/s"), color="C2")
        _finish(air, f"updraft, {shown_unit('ft/s')}")
        figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8, title=title)
    else:  # the legend takes the place of the updraft
        figure.suptitle(title, fontsize=10)
        air.set_axis_off()
        air.legend(handles, labels, loc="center", fontsize=9, title="still air")
    for axes in panels[-2:]:
        axes.set_xlabel("time, s", fontsize=8)
    return figure


def _limits_text(what: str, lowest: float, highest: float, unit: str) -> str:
    """What it is called and between which values it must stay, in the unit that is drawn."""
    if np.isinf([lowest, highest]).all():
        return f"{what}: none"
    return f"{what}: {float(shown_values(lowest, unit)):.5g} to {float(shown_values(highest, unit)):.5g}"


def _limit_lines(axes: Axes, limited: np.ndarray, limits: tuple[float, float], unit: str) -> None:
    """The limits where what they limit, (N,), came near them."""
    lowest, highest = limits
    for limit, near in (
        (lowest, limited.min() < lowest + 0.2 * (highest - lowest)),
        (highest, limited.max() > highest - 0.2 * (highest - lowest)),
    ):
        if near:
            axes.axhline(float(shown_values(limit, unit)), color="black", linestyle="--", linewidth=0.8)


def map_figure(maps: tuple[RecoverableMap, ...], title: str) -> Figure:
    """One column a set of equations: what becomes of the starts, and of dihedral commands."""
    figure = new_figure(5.2 * len(maps), 9.0)
    panels = figure.subplots(2, len(maps), squeeze=False, height_ratios=(1.25, 1.0))
    handles: dict[str, Any] = {}
    for column, each in enumerate(maps):
        handles |= _start_map(panels[0, column], each)
        _command_map(panels[1, column], each)
    figure.legend(handles=list(handles.values()), loc="outside upper center", ncols=3, fontsize=8, title=title)
    return figure


def _start_map(axes: Axes, each: RecoverableMap) -> dict[str, Any]:
    """Label -> what stands for it in the legend."""
    from matplotlib.colors import to_rgb
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found = each.starts["nonlinear"].of_starts()
    inside, returned, left, exceeded = (found[name] for name in ("held", "returned", "left_first", "exceeded"))
    picture = np.ones((*inside.shape, 3))
    handles: dict[str, Any] = {}

    def fill(where: np.ndarray, color: Any, label: str) -> None:
        picture[where] = to_rgb(color)
        handles[label] = Patch(facecolor=color, edgecolor="gray", label=label)

    fill(found["within_limits"], "white", "stayed within limits")
    for index in np.unique(exceeded[inside & (exceeded >= 0)]).tolist():
        label = f"{INPUTS[index]} exceeded its limits, inside the envelope"
        fill(inside & (exceeded == index), _GRAYS[index], label)
    for index, back in sorted(set(zip(left[~inside].tolist(), returned[~inside].tolist(), strict=True))):
        name = (*STATES, "no state")[index]
        label = f"came back, {name} had left" if back else f"lost, {name} left first"
        color = np.array(to_rgb(COLORS.get(name, "0.6")))
        fill(~inside & (left == index) & (returned == back), _PALE * color + 1 - _PALE if back else color, label)
    speeds, dihedrals = shown_values(each.speeds, "ft/s"), np.degrees(each.dihedrals)
    axes.pcolormesh(speeds, dihedrals, picture, shading="nearest")
    linear = each.starts["linear"].of_starts()["held"].astype(float)
    if min(linear.shape) > 1 and 0.0 < linear.mean() < 1.0:
        axes.contour(speeds, dihedrals, linear, levels=[0.5], colors="black", linestyles="--", linewidths=1.2)
    label = "linear model inside the envelope"
    handles[label] = Line2D([], [], color="black", linestyle="--", label=label)
    axes.plot(0, 0, "+", color="black")
    axes.set_xlabel(f"initial speed off trim, {shown_unit('ft/s')}")
    axes.set_ylabel("initial dihedral off trim, deg")
    trimmed = np.degrees(each.point.states.dihedral)
    axes.set_title(f"{each.dynamics} dynamics, trim at {trimmed:.4g} deg", fontsize=10)
    return handles


def _command_map(axes: Axes, each: RecoverableMap) -> None:
    asked = np.degrees(each.commands)
    linear, flights = each.commanded["linear"], each.commanded["nonlinear"]
    offset = np.degrees(linear.final[:, _DIHEDRAL]) - asked
    if not linear.inside.all():
        axes.plot(asked, offset, "--", color="black", linewidth=1.0, label="linear model")
    axes.plot(asked[linear.inside], offset[linear.inside], color="black", linewidth=2.0, label="linear, in envelope")
    missed = np.degrees(flights.final[:, _DIHEDRAL]) - asked
    arrived = flights.arrived(each.commands)
    for chosen, color, fill, label in (
        (arrived & flights.within_limits, "C0", "full", "within limits"),
        (arrived & flights.inside & ~flights.within_limits, "0.5", "full", "exceeded control limits"),
        (arrived & ~flights.inside, "C0", "none", "arrived, had left"),
    ):
        if chosen.any():
            axes.plot(asked[chosen], missed[chosen], "o", color=color, markersize=4, fillstyle=fill, label=label)
    for index in np.unique(flights.left[~arrived]).tolist():
        rows = ~arrived & (flights.left == index)
        name = (*STATES, "no state")[index]
        label = f"lost, {name} left first"
        axes.plot(asked[rows], offset[rows], "x", color=COLORS.get(name, "black"), markersize=5, label=label)
    axes.set_xlabel("commanded dihedral off trim, deg")
    axes.set_ylabel("reached minus commanded, deg")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)


def _finish(axes: Axes, label: str) -> None:
    axes.set_ylabel(label, fontsize=8)
    axes.tick_params(labelsize=7)
    axes.ticklabel_format(useOffset=False)
    axes.grid(alpha=0.3)
