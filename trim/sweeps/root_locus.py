"""Picture of the eigenvalues along a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.reporting.figure import new_figure, save
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import UNITS
from trim.sweeps.sweep import Sweep

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: A mode is slow when it never has a larger share of the fastest eigenvalue.
_SLOW = 0.15


def root_locus(result: Sweep, path: Path, source: str = "") -> None:
    """Draw `root_locus_figure` into a .png, .svg or .pdf file."""
    save(root_locus_figure(result), path, source)


def slow_columns(result: Sweep) -> np.ndarray:
    """(n,) which eigenvalues stay slow along the sweep: below a share of the fastest everywhere."""
    size = np.nanmax(np.abs(result.eigenvalues), axis=0)
    return np.asarray(size < _SLOW * size.max())


def root_locus_figure(result: Sweep) -> Figure:
    """Eigenvalues of a sweep in its last variable, one color a mode, the slow ones enlarged; its ends marked.

    BadInputError when no point of it has a trim: there is nothing to draw.
    """
    if not result.mode_names:
        raise BadInputError("no point of the sweep has a trim: there is no root locus to draw")
    slow = slow_columns(result)
    parts = [("all modes", np.ones(len(slow), dtype=bool))]
    if slow.any() and not slow.all():
        parts.append(("the slow modes", slow))
    figure = new_figure(10.0, 5.2)
    for axes, (title, shown) in zip(figure.subplots(1, len(parts), squeeze=False)[0], parts, strict=True):
        _draw(axes, result, shown)
        axes.set_title(f"{result.dynamics} dynamics, {title}", fontsize=10)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=8)
    return figure


def _draw(axes: Axes, result: Sweep, shown: np.ndarray) -> None:
    """The columns that are shown, a line a mode, and both ends of the sweep."""
    variable = result.variables[-1]
    values = result.values[:, -1]
    is_angle = UNITS[variable] == "rad"
    values = np.degrees(values) if is_angle else values
    unit = "deg" if is_angle else UNITS[variable]
    names = list(dict.fromkeys(result.mode_names))
    for column in np.flatnonzero(shown).tolist():
        name = result.mode_names[column]
        style = ("-", "--", "-.", ":")[names.index(name) % 4]
        label = name if column == result.mode_names.index(name) else None
        roots = result.eigenvalues[:, column]
        axes.plot(roots.real, roots.imag, style, color=f"C{names.index(name)}", label=label)
    trimmed = np.flatnonzero(result.trimmed)
    for end, marker in ((trimmed[0], "o"), (trimmed[-1], "s")):
        roots = result.eigenvalues[end, shown]
        note = f"{variable} {values[end]:.4g} {unit}"
        axes.plot(roots.real, roots.imag, marker, color="black", fillstyle="none", markersize=5, label=note)
    axes.axvline(0.0, color="gray", linewidth=0.8)
    axes.set_xlabel("real part, 1/s")
    axes.set_ylabel("imaginary part, 1/s")
    axes.grid(alpha=0.3)
