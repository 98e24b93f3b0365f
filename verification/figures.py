"""Figures of verdicts: learned and exact P or K, and errors of several critics."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa_support.reporting.figure import new_figure
from verification.reports import grade_text, solution_words
from verification.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Entries below this fraction of the largest are drawn on a linear scale.
_LINEAR_SHARE = 1e-4
#: Smaller errors are rounding, whose size differs between machines. They are drawn at this value,
#: the lower end of the axis.
_ROUNDED = 1e-12
#: Smaller relative differences are not drawn.
_LEAST_DIFFERENCE = 1e-6


def verdict_figure(verdict: Verdict, make: Callable[[float, float], Figure] = new_figure) -> Figure:
    """Return a figure with heat maps of a critic's P, the exact P, and their relative difference.

    - For a critic without P, the maps are those of K.
    - The relative difference is omitted if every entry is below `_LEAST_DIFFERENCE` in magnitude.

    The color scale is symmetric logarithmic and linear near 0.

    verdict: verdict on the critic
    make: function (width, height) -> empty figure, in inches
    """
    names = verdict.exact.names
    solution = solution_words(verdict.exact.game)
    title = f"Critic on {names.origin}\nagainst the exact {solution}: {grade_text(verdict)}"
    name = "K" if verdict.critic.P is None else "P"
    rows = names.inputs if name == "K" else names.states
    learned = getattr(verdict.critic, name)
    exact = getattr(verdict.exact, name)
    largest = float(np.abs(exact).max())
    with np.errstate(divide="ignore", invalid="ignore"):  # undefined if the exact entry is 0
        relative = np.ma.masked_invalid((learned - exact) / np.abs(exact))
    relative[np.abs(relative) < _ROUNDED] = 0.0
    difference = float(np.ma.filled(np.abs(relative), 0.0).max())
    maps: list[tuple[str, np.ndarray, float | None]] = [
        (f"{name} learned", learned, largest),
        (f"{name} exact", exact, largest),
    ]
    if difference < _LEAST_DIFFERENCE:
        title += f"; relative differences below {max(difference, _ROUNDED):.1g} in every entry"
    else:
        maps.append(("(learned - exact) / |exact|", relative, None))
    figure = make(4.0 * len(maps) + 0.5, 4.0)
    figure.suptitle(title, fontsize=11)
    grid = figure.add_gridspec(1, len(maps))
    for index, (map_title, entries, size) in enumerate(maps):
        axes = figure.add_subplot(grid[0, index])
        _heat_map(figure, axes, map_title, entries, size)
        axes.set_xticks(range(len(names.states)), names.states, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        if any(names.state_units) and size is not None:
            units = ", ".join(dict.fromkeys(names.state_units))
            per = "inputs per states" if name == "K" else "cost per states squared"
            axes.set_xlabel(f"{per}, states in {units}", fontsize=7)
    return figure


def verdicts_figure(verdicts: Mapping[str, Verdict]) -> Figure:
    """Return a figure of the errors and excess costs of several critics, in their order.

    For a single critic, the result is its `verdict_figure`.

    verdicts: source of each critic -> its verdict
    """
    judged = list(verdicts.values())
    if len(verdicts) == 1:
        return verdict_figure(judged[0])
    figure = new_figure(12.0, 4.2)
    origin = judged[0].exact.names.origin
    figure.suptitle(f"Critics on {origin}, against the exact game solution")
    axes = figure.add_subplot()
    positions = np.arange(len(verdicts))
    curves = {
        "error of P": np.array([verdict.P_rel_error for verdict in judged]),
        "error of K": np.array([verdict.K_rel_error for verdict in judged]),
        "largest error": np.array([verdict.largest_error for verdict in judged]),
        "cost above the linear optimum": np.array(
            [verdict.cost_lost / 100.0 for verdict in judged]
        ),
    }
    _draw_errors(axes, positions, curves)
    names = [Path(name).name for name in verdicts]
    axes.set_xticks(positions, names, rotation=30, ha="right", fontsize=7)
    return figure


def _draw_errors(axes: Axes, positions: np.ndarray, curves: Mapping[str, np.ndarray]) -> None:
    """Draw the curves that have a number on a logarithmic scale, with a legend.

    curves: label -> value of each critic
    """
    shown = {label: values for label, values in curves.items() if not np.all(np.isnan(values))}
    for (label, values), style in zip(shown.items(), ("-", "--", "-.", ":"), strict=False):
        axes.semilogy(positions, np.maximum(values, _ROUNDED), style, label=label)
    if any(np.nanmin(values, initial=np.inf) < _ROUNDED for values in shown.values()):
        axes.set_ylim(bottom=_ROUNDED)
        axes.text(0.0, 0.0, " rounding", transform=axes.transAxes, va="bottom", fontsize=7)
    axes.set_ylabel("relative error")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _heat_map(
    figure: Figure, axes: Axes, title: str, matrix: np.ndarray, size: float | None
) -> None:
    """Draw a matrix as a heat map with a color bar.

    size: largest magnitude on the color scale; None for relative differences, whose own is taken
    """
    from matplotlib.colors import SymLogNorm

    axes.set_title(title)
    is_difference = size is None
    if size is None:
        size = 10.0 ** np.ceil(np.log10(2.0 * np.ma.filled(np.abs(matrix), 0.0).max()))
        linear = size * _LINEAR_SHARE
        powers = size * np.array([1.0, 0.1, 0.01])
    else:
        size = size or 1.0
        linear = size * _LINEAR_SHARE
        powers = 10.0 ** (np.floor(np.log10(size)) - np.array([0.0, 1.0, 2.0]))
    norm = SymLogNorm(linthresh=linear, vmin=-size, vmax=size)
    image = axes.imshow(matrix, cmap="RdBu_r", norm=norm, aspect="auto")
    ticks = [*-powers, 0.0, *powers[::-1]]
    bar = figure.colorbar(image, ax=axes, ticks=ticks, format="%g")
    bar.ax.minorticks_off()
    if is_difference:
        bar.ax.set_yticklabels([f"{tick:+.2g}" if tick else "0" for tick in ticks])
