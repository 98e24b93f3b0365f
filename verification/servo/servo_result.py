"""What a law does in a case of `hfa servo`, and the picture of all laws in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.tracking import Tracked
from hfa_model.reporting.figure import new_figure
from hfa_model.reporting.text import shown_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
