"""Picture of the eigenvalues along a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.support.figure import new_figure, save
from hfa_model.vectors import UNITS
from trim.sweeps.sweep import Sweep

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def root_locus(result: Sweep, path: Path, source: str = "") -> None:
    """Draw `root_locus_figure` into a .png or .svg file."""
    save(root_locus_figure(result), path, source)


def root_locus_figure(result: Sweep) -> Figure:
    """Eigenvalues of a sweep in its last variable, one color a mode, the slow ones enlarged; printed angles marked."""
    figure = new_figure(10.0, 4.6)
    variable = result.variables[-1]
    values = result.values[:, -1]
    is_angle = UNITS[variable] == "rad"
    shown = np.degrees(values) if is_angle else values
    unit = "deg" if is_angle else UNITS[variable]
    names = list(dict.fromkeys(result.mode_names))
    for index, axes in enumerate(figure.subplots(1, 2)):
        for column, name in enumerate(result.mode_names):
            style = ("-", "--", "-.", ":")[names.index(name) % 4]
            label = name if column == result.mode_names.index(name) else None
            roots = result.eigenvalues[:, column]
            axes.plot(roots.real, roots.imag, style, color=f"C{names.index(name)}", label=label)
        for end, marker in ((0, "o"), (-1, "s")):
            roots = result.eigenvalues[end]
            note = f"{variable} {shown[end]:.4g} {unit}"
            axes.plot(roots.real, roots.imag, marker, color="black", fillstyle="none", markersize=5, label=note)
        axes.axvline(0.0, color="gray", linewidth=0.8)
        axes.set_xlabel("real part, 1/s")
        axes.set_ylabel("imaginary part, 1/s")
        axes.grid(alpha=0.3)
        if index == 1:
            axes.set_xlim(-0.06, 0.06)
            axes.set_ylim(-1.0, 1.0)
    left, right = figure.axes
    left.set_title(f"{result.dynamics} dynamics")
    right.set_title("the slow modes, enlarged")
    left.legend(fontsize=8, loc="upper right", bbox_to_anchor=(0.98, 0.42))
    return figure
