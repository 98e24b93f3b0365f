"""Pictures: an empty figure drawn without a display, and files that are the same for the same data."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_model.support.files import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, the same bytes for the same data."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130, metadata={"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path, source: str = "") -> None:
    """Write a figure as .png or .svg, whole or not at all. source: where it comes from, into the file's metadata."""
    from matplotlib import rc_context

    kind = path.suffix[1:].lower()
    # The same result shall be the same file: no date, no random identifiers.
    metadata = {"Date" if kind == "svg" else "Software": None} | ({"Description": source} if source else {})
    settings: dict[str, Any] = {"format": kind, "dpi": 130, "metadata": metadata}
    with rc_context({"svg.hashsalt": "hfa"}), written_whole(path) as stream:
        figure.savefig(stream, **settings)


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
