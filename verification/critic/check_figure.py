"""A picture of a checked critic: learned and exact value side by side, and how the error fell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controller.game.learning_result import LearningResult
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.unit_system import entries_in_force, unit_in_force
from verification.critic.check_result import CriticCheck
from verification.critic.critic_errors import relative_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Entries below this share of the largest are drawn on a linear scale.
_LINEAR_SHARE = 1e-4
#: Errors below this are drawn here: a logarithmic axis has no 0. The axis begins here where an error is rounding, below
#: the other number, whose size differs from machine to machine.
_FLOOR, _ROUNDING = 1e-17, 1e-12


def check_figure(
    check: CriticCheck,
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    origin: str = "the plant",
    state_units: tuple[str, ...] = (),
    input_units: tuple[str, ...] = (),
    *,
    run: LearningResult | None = None,
    predefined_time: float | None = None,
) -> Figure:
    """P learned, exact and their relative difference as heat maps (signed logarithmic scale), K where there is no P; of
    a run also residual and error over time. origin: what the plant is called."""
    over_time = run is not None or check.history is not None
    figure = new_figure(12.0, 7.6 if over_time else 4.2)
    figure.suptitle(f"Critic on {origin}, against the exact game solution: {'PASS' if check.ok else 'FAIL'}")
    grid = figure.add_gridspec(2 if over_time else 1, 3)
    name, rows, learned, exact = "P", states, check.candidate.P, check.exact.P
    axis_units = (state_units, -1), (state_units, -1)
    if learned is None:
        name, rows, learned, exact = "K", inputs, check.candidate.K, check.exact.K
        axis_units = (input_units, 1), (state_units, -1)
    if state_units:
        learned, exact = (entries_in_force(each, *axis_units) for each in (learned, exact))
    largest = float(np.abs(exact).max())
    with np.errstate(divide="ignore", invalid="ignore"):  # no relative difference where the exact entry is 0
        relative = np.ma.masked_invalid((learned - exact) / np.abs(exact))
    maps = ((f"{name} learned", learned, largest), (f"{name} exact", exact, largest))
    for index, (title, entries, size) in enumerate((*maps, ("(learned - exact) / |exact|", relative, None))):
        axes = figure.add_subplot(grid[0, index])
        _heat_map(figure, axes, title, entries, size)
        axes.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        if state_units and size is not None:
            axes.set_xlabel(f"of states in {', '.join(dict.fromkeys(map(unit_in_force, state_units)))}", fontsize=7)
    history = check.history
    if run is not None:
        matrix = check.candidate.functions.matrix
        errors = np.array([relative_error(matrix(weights), check.exact.P) for weights in run.weights])
        curves = {"residual |e| / |z'Qz|": run.residual_norm, "error |P - P exact| / |P exact|": errors}
        _over_time(figure.add_subplot(grid[1, :]), run.times, curves, predefined_time)
    elif history is not None:
        curves = {
            "Riccati residual": history.residuals,
            "error |P - P exact| / |P exact|": history.P_errors,
            "error |K - K exact| / |K exact|": history.K_errors,
            "largest error": history.largest,
        }
        axes = figure.add_subplot(grid[1, :])
        axes.axhline(history.limit, color="C3", linewidth=0.8, label=f"limit {history.limit:g}")
        _over_time(axes, history.times, curves, history.predefined_time)
    return figure


def _over_time(axes: Axes, times: np.ndarray, curves: dict[str, np.ndarray], predefined_time: float | None) -> None:
    known = {label: values for label, values in curves.items() if not np.all(np.isnan(values))}
    for (label, values), style in zip(known.items(), ("-", "--", "-.", ":"), strict=False):
        axes.semilogy(times, np.maximum(values, _FLOOR), style, label=label)
    if predefined_time is not None:
        axes.axvline(predefined_time, color="black", linestyle=":", label=f"T_w = {predefined_time:g} s")
    if any(np.nanmin(values, initial=np.inf) < _ROUNDING for values in known.values()):
        axes.set_ylim(bottom=_FLOOR)
    axes.set_xlabel("time, s")
    axes.set_ylabel("relative size")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _heat_map(figure: Figure, axes: Axes, title: str, matrix: np.ndarray, size: float | None) -> None:
    """size: of the color scale; by default, and when it is 0, the largest entry."""
    from matplotlib.colors import SymLogNorm

    size = size or float(np.ma.filled(np.abs(matrix), 0.0).max()) or 1.0
    norm = SymLogNorm(linthresh=size * _LINEAR_SHARE, vmin=-size, vmax=size)
    image = axes.imshow(matrix, cmap="RdBu_r", norm=norm)
    axes.set_title(title)
    powers = 10.0 ** (np.floor(np.log10(size)) - np.array([0.0, 1.0, 2.0]))
    bar = figure.colorbar(image, ax=axes, shrink=0.8, ticks=[*-powers, 0.0, *powers[::-1]], format="%g")
    bar.ax.minorticks_off()
