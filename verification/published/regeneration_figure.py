"""Picture of the regenerated pairs: every entry's difference from its print."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hfa_model.reporting.figure import new_figure
from verification.published.regeneration import RegeneratedPair

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        axes.margins(x=0.01)
        axes.set_ylim(-max(3.0, 1.1 * tallest), max(3.0, 1.1 * tallest))
        axes.set_ylabel("half units")
        axes.set_title(f"regenerated minus printed, dihedral {pair.published.dihedral_deg:g} deg", fontsize=10)
        axes.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), frameon=False)
        axes.set_xticks(range(len(shown)), [entry.name for entry in heights], rotation=90, fontsize=6)
    return figure
