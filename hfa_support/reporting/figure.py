"""Figures drawn without a display, and picture files that are reproducible byte by byte."""

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


# Where its settings cannot be kept it says so, in two lines; the picture is the same.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

#: What matplotlib would write into a file and would be another one the next day; where a file says
#: what it is about.
_VARYING = {"png": ["Software"], "svg": ["Date"], "pdf": ["CreationDate", "Producer", "Creator"]}
_ABOUT = {"png": "Description", "svg": "Description", "pdf": "Subject"}
_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """Return the figure as PNG, the same bytes for the same data."""
    stream = io.BytesIO()
    _write(figure, stream, "png", {"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path, source: str = "") -> None:
    """Write a figure as .png, .svg or .pdf, whole or not at all.

    source: provenance, printed below the picture and stored in the file's metadata
    """
    from matplotlib import rc_context

    kind = path.suffix[1:].lower()
    # The same result shall be the same file: no date, no random identifiers.
    metadata: dict[str, Any] = dict.fromkeys(_VARYING[kind])
    if source:
        metadata[_ABOUT[kind]] = source
        _caption(figure, source)
    with rc_context({"svg.hashsalt": "hfa"}), written_whole(path) as stream:
        _write(figure, stream, kind, metadata)


def _write(figure: Figure, stream: IO[bytes], kind: str, metadata: dict[str, Any]) -> None:
    """Write a figure to a stream.

    The layout of a PNG is computed here, because matplotlib would draw the figure twice.
    """
    _take_literally(figure)
    engine = figure.get_layout_engine()
    if kind == "png" and figure.axes and engine is not None:
        figure.dpi = _DPI
        engine.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(stream, format=kind, dpi=_DPI, metadata=metadata)
    figure.set_layout_engine(engine)


def _take_literally(figure: Figure) -> None:
    """Show every text of the figure literally.

    matplotlib would typeset text between two dollar signs, as in the name of a state, as a formula.
    The powers of ten at logarithmic axes stay formulas.
    """
    from matplotlib.text import Text
    from matplotlib.ticker import LogFormatter

    powers = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            labels = axis.get_ticklabels(which="both")  # makes those that there are not yet
            if isinstance(axis.get_major_formatter(), LogFormatter):
                powers.update(labels)
    for text in figure.findobj(Text):
        if text not in powers:
            text.set_parse_math(False)


def _caption(figure: Figure, text: str) -> None:
    """Write small text in a strip below the picture.

    A legend outside of the axes must be above them.
    """
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    lines = textwrap.wrap(text, width=int(18 * figure.get_figwidth()))
    strip = (0.12 * len(lines) + 0.08) / figure.get_figheight()
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.text(0.01, 0.2 * strip, "\n".join(lines), fontsize=6, color="0.4", va="bottom")


def pyplot_figure(width: float, height: float) -> Figure:
    """Return an empty pyplot figure, which notebooks show; width and height in inches."""
    from matplotlib import pyplot

    return pyplot.figure(figsize=(width, height), layout="constrained")


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure that needs no display; width and height in inches."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ValueError as error:
        raise BadInputError(
            f"matplotlib does not start ({error}); check MPLBACKEND and matplotlibrc"
        ) from error

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
