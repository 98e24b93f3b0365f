"""Pictures of results; draws, computes nothing."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.files import written_whole
from hfa_model.vectors import STATE_UNITS
from trim.sweep import Sweep
from verification.regeneration import RegeneratedPair

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def root_locus(result: Sweep, path: Path) -> None:
    """Draw `root_locus_figure` into a .png or .svg file."""
    save(root_locus_figure(result), path)


def root_locus_figure(result: Sweep) -> Figure:
    """Eigenvalues of a sweep in its last variable, one color a mode, the slow ones enlarged; printed angles marked."""
    figure = new_figure(10.0, 4.6)
    variable = result.variables[-1]
    values = result.values[:, -1]
    is_angle = getattr(STATE_UNITS, variable) == "rad"
    shown = np.degrees(values) if is_angle else values
    unit = "deg" if is_angle else getattr(STATE_UNITS, variable)
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


def regeneration_figure(pairs: tuple[RegeneratedPair, ...]) -> Figure:
    """Regenerated minus printed, every entry, in half units of the last printed digit."""
    figure = new_figure(10.0, 2.6 * len(pairs))
    columns = list(zip(*(pair.entries for pair in pairs), strict=True))
    shown = [column for column in columns if any(entry.printed for entry in column)]
    tallest = max(abs(entry.half_units) for column in shown for entry in column)
    panels = figure.subplots(len(pairs), 1, sharex=True, squeeze=False)[:, 0]
    for axes, pair, heights in zip(panels, pairs, zip(*shown, strict=True), strict=True):
        axes.axhspan(-1, 1, color="0.88", label="prints the same")
        axes.bar(range(len(shown)), [entry.half_units for entry in heights], color="C0", width=0.7)
        axes.set_ylim(-max(3.0, 1.1 * tallest), max(3.0, 1.1 * tallest))
        axes.set_ylabel("half units")
        axes.set_title(f"regenerated minus printed, dihedral {pair.published.dihedral_deg:g} deg", fontsize=10)
        axes.legend(fontsize=8, loc="upper right")
        axes.set_xticks(range(len(shown)), [entry.name for entry in heights], rotation=90, fontsize=6)
    return figure


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, the same bytes for the same data."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130, metadata={"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path) -> None:
    """Write a figure as .png or .svg, whole or not at all."""
    from matplotlib import rc_context

    kind = path.suffix[1:].lower()
    # The same result shall be the same file: no date, no random identifiers.
    unstamped = {"Date": None} if kind == "svg" else {"Software": None}
    settings: dict[str, Any] = {"format": kind, "dpi": 130, "metadata": unstamped}
    with rc_context({"svg.hashsalt": "hfa"}), written_whole(path) as stream:
        figure.savefig(stream, **settings)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
