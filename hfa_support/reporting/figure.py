"""Pictures: an empty figure drawn without a display, and files that are the same for the same data."""

from __future__ import annotations

import io
import logging
import textwrap
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import written_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D


# Where its settings cannot be kept it says so, in two lines; the picture is the same.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

#: s; shown in the inset of a picture that is more than `_LONG` times as long.
_FIRST, _LONG = 1.0, 5.0
#: Share of the range of all values that the first second takes up, from which it gets its inset.
_SWEEPING = 0.5
#: Of the height of the axes: what is left free of later curves, and the inset within it, with room for its numbers.
_FREE, _ABOVE, _BELOW = 0.54, 0.09, 0.1
_LEFT, _WIDTH = 0.36, 0.6
#: What matplotlib would write into a file and would be another one the next day; where a file says what it is about.
_VARYING = {"png": ["Software"], "svg": ["Date"], "pdf": ["CreationDate", "Producer", "Creator"]}
_ABOUT = {"png": "Description", "svg": "Description", "pdf": "Subject"}
_DPI = 130


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, the same bytes for the same data."""
    stream = io.BytesIO()
    _write(figure, stream, "png", {"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path, source: str = "") -> None:
    """Write a figure as .png, .svg or .pdf, whole or not at all.

    source: where it comes from, below the picture and in the file's metadata.
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
    """Laid out here where it is made of points: to have it laid out, matplotlib draws all of it, and then once more."""
    engine = figure.get_layout_engine()
    if kind == "png" and figure.axes and engine is not None:
        figure.dpi = _DPI
        engine.execute(figure)
        figure.set_layout_engine(None)
    figure.savefig(stream, format=kind, dpi=_DPI, metadata=metadata)
    figure.set_layout_engine(engine)


def _caption(figure: Figure, text: str) -> None:
    """Small print in a strip below the picture. A legend outside of the axes belongs above them."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    lines = textwrap.wrap(text, width=int(18 * figure.get_figwidth()))
    strip = (0.12 * len(lines) + 0.08) / figure.get_figheight()
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.text(0.01, 0.2 * strip, "\n".join(lines), fontsize=6, color="0.4", va="bottom")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, drawn without a display."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ValueError as error:
        raise BadInputError(f"matplotlib does not start, check MPLBACKEND and matplotlibrc: {error}") from error

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def enlarge_first_second(axes: Axes) -> Axes | None:
    """The first second of a long flight, where it takes most of the height, on linear axes where no later curve runs.

    Room is made where there is too little. Lines of two points are marks and limits: not enlarged, but not hidden.
    """
    lines = [line for line in axes.lines if len(np.asarray(line.get_xdata())) != 2]
    ends = [np.asarray(line.get_ydata(), dtype=float) for line in axes.lines if line not in lines]
    curves = [np.asarray(line.get_xydata(), dtype=float) for line in lines]
    scale = axes.yaxis.get_transform()
    x, y = np.concatenate([np.zeros((0, 2)), *curves]).T
    y = np.where(np.isfinite(y), scale.transform(y), np.nan)
    early, late = y[x <= _FIRST], y[x > _FIRST]
    if x.max(initial=0.0) <= _LONG * _FIRST or not (np.isfinite(early).any() and np.isfinite(late).any()):
        return None
    size = np.nanmax(y) - np.nanmin(y)
    if size == 0.0 or np.nanmax(early) - np.nanmin(early) < _SWEEPING * size:
        return None
    if np.nanmax(late) - np.nanmin(late) > (1 - _SWEEPING / 2) * size:
        return None
    later = np.concatenate([late, *(scale.transform(pair) for pair in ends if pair[0] == pair[1])])
    lowest, highest = (float(find(np.concatenate([y, later]))) for find in (np.nanmin, np.nanmax))
    low, high = float(np.nanmin(later)), float(np.nanmax(later))
    margin = 0.04 * size
    bottom, top = lowest - margin, highest + margin
    if highest - high > low - lowest:
        top = max(top, (high + margin - _FREE * bottom) / (1.0 - _FREE))
        begin, end = (high + margin - bottom) / (top - bottom), 1.0
    else:
        bottom = min(bottom, (low - margin - _FREE * top) / (1.0 - _FREE))
        begin, end = 0.0, (low - margin - bottom) / (top - bottom)
    axes.set_ylim(*scale.inverted().transform([bottom, top]))
    inset = axes.inset_axes((_LEFT, begin + _BELOW, _WIDTH, end - begin - _ABOVE - _BELOW), zorder=7)
    for line, points in zip(lines, curves, strict=True):
        _redraw(inset, line, points[points[:, 0] <= _FIRST])
    inset.set_xlim(-0.02 * _FIRST, _FIRST)
    inset.set_title("first second, s", fontsize=7, pad=2)
    inset.tick_params(labelsize=6, length=2, pad=1)
    inset.ticklabel_format(useOffset=False)
    inset.grid(alpha=0.3)
    return inset


def _redraw(axes: Axes, line: Line2D, points: np.ndarray) -> None:
    (twin,) = axes.plot(*points.T)
    twin.update_from(line)
    twin.set(transform=axes.transData, clip_path=axes.patch, markevery=line.get_markevery(), zorder=line.get_zorder())
