"""Figure of an assessment: spectral radius versus delay, and outcomes of flights or margins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_flight.judge.assessed_point import AssessedPoint, scheduled_value
from hfa_flight.judge.outcomes import Outcomes
from hfa_support.reporting.text import shown_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def drawn_assessment(points: Sequence[AssessedPoint], figure: Figure) -> Figure:
    """Draw the spectral radius versus delay and the outcomes of the flights, and return the figure.

    Disk margins replace the outcomes if all flights converge, if all leave the envelope, or if
    there are no flights.
    """
    from matplotlib import colormaps

    left, right = figure.subplots(1, 2)
    labels = []
    shades = colormaps["viridis"](np.linspace(0.0, 0.75, len(points)))
    for number, point in enumerate(points):
        value = next(iter(scheduled_value(point.point).values()), None)
        labels.append("trim" if value is None else f"{value:.4g}")
        if point.delays is None:
            continue
        radii = point.delays.radii[:12]
        delays = 1e3 * point.deployed.deployment.dt * np.arange(len(radii))
        left.plot(delays, radii, "o-", color=shades[number], markersize=3, label=labels[-1])
    left.axhline(1.0, color="C3", linewidth=0.8, label="limit of stability")
    model = points[0].point.model
    schedule = f"{model.schedule}, {shown_unit(model.schedule_unit)}" if model.schedule else ""
    left.set_xlabel("delay, ms")
    left.set_ylabel("spectral radius of the sampled loop")
    left.grid(alpha=0.3)
    if len(labels) <= 8:
        left.legend(
            fontsize=8,
            title=schedule,
            title_fontsize=8,
            ncols=4,
            loc="lower center",
            bbox_to_anchor=(0.5, 1.0),
            frameon=False,
        )
    places = np.arange(len(labels))
    outcomes = [point.flights for point in points]
    flown = [outcome for outcome in outcomes if outcome is not None]
    converge = all(outcome.converged == outcome.starts for outcome in flown)
    if converge or all(outcome.left_envelope == outcome.starts for outcome in flown):
        _draw_margins(right, points, shades)
        if flown:
            end = "converges" if converge else "leaves the envelope"
            right.set_title(f"disk margins; every flight {end}", fontsize=10)
    else:
        _draw_outcomes(right, outcomes)
    right.set_xlim(-1.0, len(labels))
    right.set_xticks(places, labels, rotation=0 if len(labels) <= 8 else 90)
    right.set_xlabel(schedule)
    return figure


def _draw_margins(axes: Axes, points: Sequence[AssessedPoint], shades: np.ndarray) -> None:
    """Draw the disk margin of each trim, 0 without margins."""
    margins = [point.margins for point in points]
    disks = [0.0 if margin is None else margin.disk.disk for margin in margins]
    axes.bar(np.arange(len(disks)), disks, color=shades, width=0.6)
    axes.set_ylabel("disk margin, all inputs at once")


def _draw_outcomes(axes: Axes, outcomes: Sequence[Outcomes | None]) -> None:
    """Draw the percentages of flights that converge, leave the envelope, or do neither."""
    places = np.arange(len(outcomes))
    converged = np.zeros(len(outcomes))
    left = np.zeros(len(outcomes))
    flown = np.zeros(len(outcomes))
    for number, outcome in enumerate(outcomes):
        if outcome is not None:
            converged[number] = 100.0 * outcome.converged / outcome.starts
            left[number] = 100.0 * outcome.left_envelope / outcome.starts
            flown[number] = 100.0
    neither = flown - converged - left
    axes.bar(places, converged, color="C0", width=0.6, label="converge")
    axes.bar(places, neither, bottom=converged, color="0.7", width=0.6, label="do neither")
    axes.bar(
        places, left, bottom=converged + neither, color="C3", width=0.6, label="leave the envelope"
    )
    axes.set_ylim(0.0, 100.0)
    axes.set_ylabel("flights, %")
    axes.legend(fontsize=8, ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0), frameon=False)
