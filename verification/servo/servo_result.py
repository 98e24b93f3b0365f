"""What the laws do in a case of `hfa servo`: their errors, the picture of all of them, one table a case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.design.design import signal_unit
from controller.flight.tracking import Tracked
from hfa_model.reporting.figure import new_figure
from hfa_model.reporting.report import Block, Report
from hfa_model.reporting.text import Table, shown_unit, shown_values
from hfa_model.reporting.unit_system import in_force
from verification.servo.reference_model import REGULATED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.servo-table/1"
_ACCELERATION = signal_unit(REGULATED[1])


@dataclass(frozen=True, eq=False)
class ServoFlight:
    """A law in a case. lost_at: s, None when it held; left: the state that left its envelope first. fastest: largest
    |ΔU / Δt| of the surfaces, rad/s. tracked: each commanded output."""

    law: str
    times: np.ndarray
    tracked: tuple[Tracked, ...]
    fastest: float
    lost_at: float | None
    left: str | None

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
    """Each commanded output with its command, and below it what every law misses; a lost law ends with a cross."""
    names = [each.name for each in flights[0].tracked]
    figure = new_figure(5.2 * len(names), 6.0)
    panels = figure.subplots(2, len(names), sharex=True, squeeze=False)
    longest = max(flights, key=lambda flight: len(flight.times))
    for column, name in enumerate(names):
        unit = longest.tracked[column].unit
        command = shown_values(longest.tracked[column].command, unit)
        above, below = panels[:, column]
        above.plot(longest.times, command, ":", color="black", label="command")
        for flight, style in zip(flights, cycle(("-", "--", "-.", (0, (1, 1)))), strict=False):
            each = flight.tracked[column]
            output, error = (shown_values(value, unit) for value in (each.output, each.output - each.command))
            (line,) = above.plot(flight.times, output, linestyle=style, linewidth=1.2, label=flight.law)
            below.plot(flight.times, error, linestyle=style, linewidth=1.2, color=line.get_color())
            if flight.lost_at is not None:
                below.plot(flight.times[-1], error[-1], "x", color=line.get_color())
        span = float(np.abs(command).max() or 1.0)
        above.set_ylim(-2.0 * span, 2.0 * span)
        below.set_ylim(-span, span)
        above.set_title(name, fontsize=9)
        above.set_ylabel(f"off trim, {shown_unit(unit)}", fontsize=8)
        below.set_ylabel(f"off its command, {shown_unit(unit)}", fontsize=8)
        below.set_xlabel("time, s", fontsize=8)
        for axes in (above, below):
            axes.grid(alpha=0.3)
            axes.tick_params(labelsize=7)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=6, fontsize=8, title=title
    )
    return figure


def servo_report(results: Sequence[Mapping[str, Any]]) -> Report:
    """Root mean square errors, surface rates, and what was lost, law by law."""
    blocks = [Block((_title(result), _table(result))) for result in results]
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
