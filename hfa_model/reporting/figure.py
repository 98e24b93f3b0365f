"""Pictures: an empty figure drawn without a display, and files that are the same for the same data."""

from __future__ import annotations

import io
import logging
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model.support.files import written_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Where its settings cannot be kept it says so, in two lines; the picture is the same.
logging.getLogger("matplotlib").setLevel(logging.ERROR)

#: s; and how many times what follows the first second must be smaller for it to be enlarged.
_FIRST, _TRANSIENT = 1.0, 2.0
#: What matplotlib would write into a file and would be another one the next day; where a file says what it is about.
_VARYING = {"png": ["Software"], "svg": ["Date"], "pdf": ["CreationDate", "Producer", "Creator"]}
_ABOUT = {"png": "Description", "svg": "Description", "pdf": "Subject"}


def png_bytes(figure: Figure) -> bytes:
    """The figure as PNG, the same bytes for the same data."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=130, metadata={"Software": None})
    return stream.getvalue()


def save(figure: Figure, path: Path, source: str = "") -> None:
    """Write a figure as .png, .svg or .pdf, whole or not at all.

    source: where it comes from, below the picture and in the file's metadata.
    """
    from matplotlib import rc_context

    kind = path.suffix[1:].lower()
    # The same result shall be the same file: no date, no random identifiers.
    metadata: dict[str, Any] = dict.fromkeys(_VARYING[kind])
    settings: dict[str, Any] = {"format": kind, "dpi": 130, "metadata": metadata}
    if source:
        metadata[_ABOUT[kind]] = source
        _caption(figure, source)
    with rc_context({"svg.hashsalt": "hfa"}), written_whole(path) as stream:
        figure.savefig(stream, **settings)


def _caption(figure: Figure, text: str) -> None:
    """Small print in a strip of its own below the picture. A legend outside of the axes belongs above them."""
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    lines = textwrap.wrap(text, width=int(18 * figure.get_figwidth()))
    strip = (0.12 * len(lines) + 0.08) / figure.get_figheight()
    engine = figure.get_layout_engine()
    if isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(0.0, strip, 1.0, 1.0 - strip))
    figure.text(0.01, 0.2 * strip, "\n".join(lines), fontsize=6, color="0.4", va="bottom")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of that size in inches, drawn without a display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def enlarge_first_second(axes: Axes) -> None:
    """The first second enlarged, where it is over before the rest begins: away from where the curves settle."""
    lines = [line for line in axes.lines if len(np.asarray(line.get_xdata())) > 2]  # a limit has two points
    curves = [np.asarray(line.get_xydata()).T for line in lines]
    if max((float(times[-1]) for times, _ in curves), default=0.0) < 5 * _FIRST:
        return
    early = np.concatenate([values[times <= _FIRST] for times, values in curves])
    late = np.concatenate([values[times > _FIRST] for times, values in curves])
    if not np.nanmax(early) - np.nanmin(early) >= _TRANSIENT * (np.nanmax(late) - np.nanmin(late)):
        return
    above = _room_beside(axes, float(np.nanmin(late)), float(np.nanmax(late)))
    inset = axes.inset_axes((0.3, 0.54 if above else 0.12, 0.6, 0.36))
    for line in lines:
        inset.plot(*line.get_data(), color=line.get_color(), linestyle=line.get_linestyle(), linewidth=0.8)
    inset.set_xlim(0.0, _FIRST)
    inset.set_title("first second, s", fontsize=6, pad=2)
    inset.tick_params(labelsize=6)
    inset.ticklabel_format(useOffset=False)
    inset.grid(alpha=0.3)


def _room_beside(axes: Axes, lowest: float, highest: float) -> bool:
    """Make the half above or below what lies between these values free, by longer axes if need be; whether above."""
    low, high = axes.get_ylim()
    above = high - highest > lowest - low
    lacking = max(0.52 * (high - low) - (high - highest if above else lowest - low), 0.0) / 0.48
    axes.set_ylim(low - (0.0 if above else lacking), high + (lacking if above else 0.0))
    return above
