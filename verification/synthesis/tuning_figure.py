"""What a search has seen, as a picture: how well commands are followed against what a gust needs of the envelope."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.reporting.figure import new_figure
from verification.synthesis.tuning import Evaluation, Tuning
from verification.synthesis.tuning_report import error_name, shown_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def trade_off(tuning: Tuning, seen: Sequence[Evaluation]) -> np.ndarray:
    """Largest rms error of a case in the first output of the objective, and largest share of the envelope in a gust
    (without gusts: largest rate, rad/s), of every evaluation with stable loops, (N, 2)."""
    first = next(iter(tuning.objective))
    stable = [each for each in seen if each.errors]
    worst = [(max(errors[first] for errors in each.errors), max(each.gusts or each.rates)) for each in stable]
    return np.array(worst).reshape(len(stable), 2)


def best_of_both(points: np.ndarray) -> np.ndarray:
    """Those of (N, 2) than which no other is smaller in both, by the first, (k, 2)."""
    ordered = points[np.lexsort(points.T[::-1])]
    lowest = np.minimum.accumulate(ordered[:, 1])
    return ordered[np.append(True, lowest[1:] < lowest[:-1])] if len(ordered) else ordered


def tuning_figure(tuning: Tuning, seen: Sequence[Evaluation]) -> Figure:
    """Every stable evaluation, and the line of those that no other beats in both."""
    first = next(iter(tuning.objective))
    points = trade_off(tuning, seen)
    if not tuning.gusts:
        points[:, 1] = np.degrees(points[:, 1])
    points[:, 0] = [shown_error(value, first) for value in points[:, 0]]
    front = best_of_both(points)
    figure = new_figure(6.0, 4.0)
    axes = figure.subplots()
    axes.plot(*points.T, ".", markersize=3, color="tab:gray", label="evaluations with stable loops")
    axes.plot(*front.T, ".-", drawstyle="steps-post", color="tab:blue", label="no other is better in both")
    if tuning.gusts:
        axes.axhline(1.0, linestyle=":", color="black", label="the envelope")
        axes.set_ylim(0.0, 2.0)
    if len(points):
        axes.set_xlim(0.9 * points[:, 0].min(), min(1.05 * points[:, 0].max(), 2.0 * float(np.median(points[:, 0]))))
    axes.set_xlabel(f"largest rms error of a case, {error_name(first)}", fontsize=8)
    axes.set_ylabel("largest share of the envelope in a gust" if tuning.gusts else "fastest surface, deg/s", fontsize=8)
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    return figure
