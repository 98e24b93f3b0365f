"""Figures drawn without a display. Their files are reproducible byte by byte."""

from __future__ import annotations

import io
import logging
import textwrap
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from hfa_support.errors import BadInputError
from hfa_support.files import written_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure


# Suppress matplotlib's message that its settings folder is not writable.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

#: Suffix -> metadata of matplotlib that vary from run to run, and the key of a description.
_VARYING_METADATA = {
    "png": ["Software"],
    "svg": ["Date"],
    "pdf": ["CreationDate", "Producer", "Creator"],
}
_DESCRIPTION_KEY = {"png": "Description", "svg": "Description", "pdf": "Subject"}
_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """Return a figure as the content of a PNG file. Equal data give equal bytes."""
    stream = io.BytesIO()
    _write(figure, stream, "png", {"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path, source: str = "") -> None:
    """Write a figure as .png, .svg or .pdf, completely or not at all.

    path: path of the file
    source: provenance, printed below the picture and stored in the metadata of the file; "" for
        none

    Raises KeyError for any other suffix, and BadInputError as `written_whole` does.
    """
    from matplotlib import rc_context

    kind = path.suffix[1:].lower()
    # Equal results must give equal files: no date and no random identifiers.
    metadata: dict[str, Any] = dict.fromkeys(_VARYING_METADATA[kind])
    if source:
        metadata[_DESCRIPTION_KEY[kind]] = source
        _caption(figure, source)
    with rc_context({"svg.hashsalt": "hfa"}), written_whole(path) as stream:
        _write(figure, stream, kind, metadata)


def _write(figure: Figure, stream: IO[bytes], kind: str, metadata: dict[str, Any]) -> None:
    """Write a figure to a stream.

    kind: "png", "svg" or "pdf"
    metadata: entries of the file; None leaves out one that matplotlib would write
    """
    _take_literally(figure)
    engine = figure.get_layout_engine()
    if kind == "png" and figure.axes and engine is not None:
        # The layout is computed once: `savefig` would draw the figure a first time for it.
        figure.dpi = _DPI
        engine.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(stream, format=kind, dpi=_DPI, metadata=metadata)
    figure.set_layout_engine(engine)


def _take_literally(figure: Figure) -> None:
    """Let matplotlib print dollar signs in texts, as in a state's name, instead of formulas. Powers
    of ten on logarithmic axes remain formulas.
    """
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    powers = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            labels = axis.get_ticklabels(which="both")  # creates missing labels
            if isinstance(axis.get_major_formatter(), LogFormatter):
                powers.update(labels)
    for text in figure.findobj(Text):
        if text not in powers:
            text.set_parse_math(False)


def _caption(figure: Figure, text: str) -> None:
    """Add small text below the picture of a figure, and confine the picture to the area above the
    text.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    # In this size an inch has 18 characters, and a line is 0.12 inches high.
    lines = textwrap.wrap(text, width=int(18 * figure.get_figwidth()))
    strip = (0.12 * len(lines) + 0.08) / figure.get_figheight()
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.text(0.01, 0.2 * strip, "\n".join(lines), fontsize=6, color="0.4", va="bottom")


def pyplot_figure(width: float, height: float) -> Figure:
    """Return an empty pyplot figure, which notebooks display. Width and height are in inches."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width, height), layout="constrained")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that needs no display. Width and height are in inches.

    Raises BadInputError if matplotlib cannot be imported with its present settings.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ValueError as error:
        raise BadInputError(
            f"matplotlib cannot be loaded ({error}); check MPLBACKEND and matplotlibrc"
        ) from error

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
