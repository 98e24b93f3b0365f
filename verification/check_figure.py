"""A picture of a checked critic: learned and exact value side by side, and how the error fell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.basis import Basis
from controller.result import LearningResult
from verification.check_report import error_over_time
from verification.critic_check import CriticCheck
from verification.figures import new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_figure(
    check: CriticCheck, states: tuple[str, ...], basis: Basis, run: LearningResult | None, predefined_time: float | None
) -> Figure:
    """P learned, exact and their difference as heat maps (signed logarithmic scale); residual and error over time."""
    figure = new_figure(12.0, 3.6 if run is None else 7.0)
    rows = 1 if run is None else 2
    grid = figure.add_gridspec(rows, 3)
    exact = check.exact.P
    learned = np.full_like(exact, np.nan) if check.candidate.P is None else check.candidate.P
    largest = float(np.abs(exact).max())
    maps = (("P learned", learned, largest), ("P exact", exact, largest), ("difference", learned - exact, None))
    for index, (title, matrix, limit) in enumerate(maps):
        axes = figure.add_subplot(grid[0, index])
        _heat_map(figure, axes, title, matrix, limit, states)
    if run is not None:
        axes = figure.add_subplot(grid[1, :])
        times = np.maximum(run.times, run.times[1] / 2 if len(run.times) > 1 else 1e-3)
        floor = np.finfo(float).tiny
        axes.loglog(times, np.maximum(run.residual_norm, floor), color="C0", label="residual |e|")
        axes.loglog(times, np.maximum(error_over_time(check, run, basis), floor), "--", color="C1", label="error of P")
        if predefined_time is not None:
            axes.axvline(predefined_time, color="black", linestyle=":", label=f"T_w = {predefined_time:g} s")
        axes.set_xlabel("time, s")
        axes.set_ylabel("relative size")
        axes.grid(alpha=0.3)
        axes.legend()
    return figure


def _heat_map(
    figure: Figure, axes: object, title: str, matrix: np.ndarray, limit: float | None, states: tuple[str, ...]
) -> None:
    from matplotlib.axes import Axes
    from matplotlib.colors import SymLogNorm

    assert isinstance(axes, Axes)
    finite = np.nan_to_num(matrix)
    size = limit if limit is not None else float(np.abs(finite).max()) or 1.0
    norm = SymLogNorm(linthresh=size * 1e-4, vmin=-size, vmax=size)
    image = axes.imshow(matrix, cmap="RdBu_r", norm=norm)
    axes.set_title(title)
    axes.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(len(states)), states, fontsize=7)
    figure.colorbar(image, ax=axes, shrink=0.8)
