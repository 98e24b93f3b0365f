"""Reports as PDF files: pages of text in columns, and a page for each picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from hfa_support.files import written_whole
from hfa_support.reporting.report import Report

#: Width and height of a page, inches (A4), its margin, and size and spacing of the text, points.
_PAGE = (8.27, 11.69)
_MARGIN = 0.7
_POINTS = 9.0
_SPACING = 1.25


def write_pdf(report: Report, path: Path) -> None:
    """Write a report as PDF, each nested report on pages of its own, completely or not at all."""
    from matplotlib.backends.backend_pdf import PdfPages

    with written_whole(path) as stream, PdfPages(stream, metadata={"Creator": "hfa"}) as pages:
        for sheet in _sheets(report):
            for page in _pages(sheet.text()):
                pages.savefig(page)
            for picture in sheet.pictures():
                pages.savefig(picture.figure)


def _sheets(report: Report) -> Iterator[Report]:
    """Yield the nested reports of a report that consists of them, or the report itself."""
    if report.parts and all(isinstance(part, Report) for part in report.parts):
        for part in report.parts:
            assert isinstance(part, Report)
            yield part
    else:
        yield report


def _pages(text: str) -> Iterator[object]:
    """Yield a figure for each page of a text."""
    from hfa_support.reporting.figure import new_figure

    lines = text.split("\n")
    most = int(72.0 * (_PAGE[1] - 2.0 * _MARGIN) / (_POINTS * _SPACING))
    for first in range(0, len(lines), most):
        figure = new_figure(*_PAGE)
        figure.set_layout_engine("none")
        figure.text(
            _MARGIN / _PAGE[0],
            1.0 - _MARGIN / _PAGE[1],
            "\n".join(lines[first : first + most]),
            family="monospace",
            fontsize=_POINTS,
            linespacing=_SPACING,
            verticalalignment="top",
            parse_math=False,
        )
        yield figure
