"""What the laws do in a case of `hfa servo`: their errors, the picture of all of them, one table a case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.design.design import signal_unit
from controller.flight.nonlinear_flight import Tracked
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, shown_unit, shown_values
from hfa_support.reporting.unit_system import in_force
from verification.servo.reference_model import REGULATED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.servo-table/1"
_ACCELERATION = signal_unit(REGULATED[1])
#: What can be seen of an output in a picture, as a share of its largest command.
_SEEN = 0.01
#: Shares of the way to a limit that are drawn, %.
_SHARES = (0.1, 200.0)


@dataclass(frozen=True, eq=False)
class ServoFlight:
    """A law in a case. lost_at: s, None when it held; left: the state that left its envelope first. fastest: largest
    |ΔU / Δt| of the surfaces, rad/s. tracked: each commanded output. used: of the way from the trim to its limit, the
    share that the surface that is nearest to its own has gone, and the state, (N,) each."""

    law: str
    times: np.ndarray
    tracked: tuple[Tracked, ...]
    fastest: float
    lost_at: float | None
    left: str | None
    used: Mapping[str, np.ndarray]

    def to_dict(self) -> dict[str, Any]:
        """English units and radians."""
        units = {each.name: each.unit for each in self.tracked}
        return {
            "law": self.law,
            "rms_error": {each.name: each.rms for each in self.tracked},
            "rms_error_units": units,
            "largest_error": {each.name: each.largest for each in self.tracked},
            "largest_error_units": units,
            "fastest_surface": self.fastest,
            "lost_at": self.lost_at,
            "left": self.left,
        }


def servo_figure(title: str, flights: Sequence[ServoFlight]) -> Figure:
    """Each commanded output with its command; what every law misses; how near it comes to limits and envelope.

    Laws that nobody could tell apart are drawn once; a lost one ends with a cross.
    """
    longest = max(flights, key=lambda flight: len(flight.times))
    names = [each.name for each in longest.tracked]
    figure = new_figure(10.4, 8.6)
    panels = figure.subplots(3, 2, sharex=True, squeeze=False)
    for column, (name, used) in enumerate(zip(names, longest.used, strict=True)):
        unit = longest.tracked[column].unit
        above, below, limited = panels[:, column]
        above.plot(longest.times, shown_values(longest.tracked[column].command, unit), ":", color="black", zorder=5)
        for (label, flight), style in zip(_together(flights), cycle(("-", "--", "-.", (0, (1, 1)))), strict=False):
            each = flight.tracked[column]
            output, error = (shown_values(value, unit) for value in (each.output, each.output - each.command))
            (line,) = above.plot(flight.times, output, linestyle=style, linewidth=1.2, label=label)
            for axes, values in ((below, error), (limited, 100.0 * flight.used[used])):
                axes.plot(flight.times, values, linestyle=style, linewidth=1.2, color=line.get_color())
                if flight.lost_at is not None:
                    axes.plot(flight.times[-1], values[-1], "x", color=line.get_color())
        held = [flight.tracked[column] for flight in flights if flight.lost_at is None] or [longest.tracked[column]]
        for axes, shown in (
            (above, [value for each in held for value in (each.output, each.command)]),
            (below, [each.output - each.command for each in held]),
        ):
            ends = shown_values(np.array([min(map(np.min, shown)), max(map(np.max, shown))]), unit)
            axes.set_ylim(*(ends + 0.05 * (np.ptp(ends) or 1.0) * np.array([-1.0, 1.0])))
        limited.axhline(100.0, linestyle="--", color="black", linewidth=1.0)
        limited.set_yscale("log")
        limited.set_ylim(*_SHARES)
        above.set_title(name, fontsize=9)
        above.set_ylabel(f"off trim, {shown_unit(unit)}", fontsize=8)
        below.set_ylabel(f"off its command, {shown_unit(unit)}", fontsize=8)
        limited.set_title(f"{used} nearest to its limit", fontsize=9)
        limited.set_ylabel("of the way from the trim, %", fontsize=8)
        limited.set_xlabel("time, s", fontsize=8)
        for axes in (above, below, limited):
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=7)
    lines = [*panels[0, 0].lines, panels[2, 0].lines[-1]]
    labels = ["command", *(label for label, _ in _together(flights)), "limit"]
    figure.legend(lines, labels, loc="outside upper center", ncols=4, fontsize=8, title=title)
    figure.align_ylabels()
    return figure


def _together(flights: Sequence[ServoFlight]) -> list[tuple[str, ServoFlight]]:
    """The first of the laws that a picture cannot tell apart, under the names of all."""
    found: list[tuple[list[str], ServoFlight]] = []
    for flight in flights:
        alike = (laws for laws, other in found if _alike(flight, other))
        if laws := next(alike, None):
            laws.append(flight.law)
        else:
            found.append(([flight.law], flight))
    return [(" = ".join(laws), flight) for laws, flight in found]


def _alike(one: ServoFlight, other: ServoFlight) -> bool:
    return len(one.times) == len(other.times) and all(
        np.abs(mine.output - theirs.output).max() <= _SEEN * np.abs(mine.command).max(initial=0.0)
        for mine, theirs in zip(one.tracked, other.tracked, strict=True)
    )


def servo_report(results: Sequence[Mapping[str, Any]]) -> Report:
    """Root mean square errors, surface rates, and what was lost, law by law."""
    blocks = [((_title(result), _table(result))) for result in results]
    title = "Servos through the commands and the actuator faults of SimVFA"
    return Report(title, tuple(blocks), data={"schema": SCHEMA, "cases": list(results)})


def _title(result: Mapping[str, Any]) -> str:
    return f"case {result['case']}, {result['dynamics']} dynamics, {result['duration']:g} s"


def _table(result: Mapping[str, Any]) -> Table:
    header = ("law", "rms dihedral deg", f"rms A_z {shown_unit(_ACCELERATION)}", "fastest surface deg/s", "outcome")
    return Table(header, rows_of(result))


def rows_of(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Law, both rms errors, surface rate and outcome, a row a law."""
    angle, acceleration = REGULATED
    rows: list[tuple[str, ...]] = []
    for flight in result["flights"]:
        rms, lost = flight["rms_error"], flight["lost_at"]
        rows.append(
            (
                flight["law"],
                f"{math.degrees(rms[angle]):.3f}",
                f"{in_force(rms[acceleration], _ACCELERATION):.3f}",
                f"{math.degrees(flight['fastest_surface']):.3g}",
                "held" if lost is None else f"{flight['left']} left at {lost:.4g} s",
            )
        )
    return rows
