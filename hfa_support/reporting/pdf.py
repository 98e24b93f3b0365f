"""Reports as PDF files: pages of text in columns, and a page for each picture."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from hfa_support.files import written_whole
from hfa_support.reporting.parts import Picture

#: Width and height of a page, inches (A4), its margin, and size and spacing of the text, points.
_PAGE = (8.27, 11.69)
_MARGIN = 0.5
_POINTS = 9.0
_SPACING = 1.25
#: Width of a character of the monospaced font, relative to its size.
_ADVANCE = 0.603


def write_pdf(sheets: Iterable[tuple[str, Iterable[Picture]]], path: Path) -> None:
    """Write sheets of a text and its pictures as PDF, each sheet on pages of its own, completely or
    not at all.
    """
    from matplotlib.backends.backend_pdf import PdfPages

    with written_whole(path) as stream, PdfPages(stream, metadata={"Creator": "hfa"}) as pages:
        for text, pictures in sheets:
            for page in _pages(text):
                pages.savefig(page)
            for picture in pictures:
                pages.savefig(picture.figure)


def _pages(text: str) -> Iterator[object]:
    """Yield a figure for each page of a text."""
    from hfa_support.reporting.figure import new_figure

    lines = text.split("\n")
    width = 72.0 * (_PAGE[0] - 2.0 * _MARGIN) / _ADVANCE
    points = min(_POINTS, width / max(map(len, lines)))
    most = int(72.0 * (_PAGE[1] - 2.0 * _MARGIN) / (points * _SPACING))
    for first in range(0, len(lines), most):
        figure = new_figure(*_PAGE)
        figure.set_layout_engine("none")
        figure.text(
            _MARGIN / _PAGE[0],
            1.0 - _MARGIN / _PAGE[1],
            "\n".join(lines[first : first + most]),
            family="monospace",
            fontsize=points,
            linespacing=_SPACING,
            verticalalignment="top",
            parse_math=False,
        )
        yield figure
