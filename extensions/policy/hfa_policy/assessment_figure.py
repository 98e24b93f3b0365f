"""The picture of an assessment."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hfa_policy.assessment import scheduled_value
from hfa_support.reporting.text import shown_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_policy.assessment_report import Assessment


def assessment_figure(assessment: Assessment) -> Figure:
    """Left the spectral radius over the delay, a line a trim; right which part of the flights
    converges, leaves the envelope, or does neither, a bar a trim."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    labels = []
    for number, point in enumerate(assessment.points):
        value = next(iter(scheduled_value(point.point).values()), None)
        labels.append("trim" if value is None else f"{value:.4g}")
        if point.delays is None:
            continue
        radii = point.delays.radii[:12]
        delays = 1e3 * assessment.deployed.deployment.dt * np.arange(len(radii))
        shade = str(0.75 - 0.65 * number / max(len(assessment.points) - 1, 1))
        left.plot(delays, radii, "o-", color=shade, markersize=3, label=labels[-1])
    left.axhline(1.0, color="C3", linewidth=0.8)
    left.set_xlabel("delay, ms")
    left.set_ylabel("spectral radius of the sampled loop")
    left.grid(alpha=0.3)
    if len(labels) <= 8:
        left.legend(fontsize=8)
    places = np.arange(len(labels))
    flown = [point.flights for point in assessment.points]
    returned = np.array([0.0 if each is None else each.returned / each.starts for each in flown])
    lost = np.array([0.0 if each is None else each.lost / each.starts for each in flown])
    right.bar(places, 100 * returned, color="C0", label="converge")
    right.bar(places, 100 * lost, bottom=100 * (1 - lost), color="C3", label="leave the envelope")
    right.set_xticks(places, labels, rotation=0 if len(labels) <= 8 else 90)
    model = assessment.deployed.model
    right.set_xlabel(
        f"{model.schedule}, {shown_unit(model.schedule_unit)}" if model.schedule else ""
    )
    right.set_ylabel("flights, %")
    right.legend(fontsize=8)
    return figure
