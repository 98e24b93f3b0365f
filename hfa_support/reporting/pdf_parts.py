"""Parts of PDF documents: paragraphs, tables and groups of rows. The layout is ReportLab's, the
font DejaVu Sans, which is part of matplotlib and has Greek letters and signs.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from copy import copy
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import matplotlib
from reportlab.lib.enums import TA_LEFT, TA_RIGHT
from reportlab.lib.styles import ParagraphStyle
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import (
    CondPageBreak,
    Flowable,
    Image,
    KeepInFrame,
    Paragraph,
    Table as Grid,
)

from hfa_support.errors import printable
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, are_words, blocks_that_fit

#: Names of the font, and its files.
SANS, BOLD = "Sans", "Sans-Bold"
_FILES = {SANS: "DejaVuSans.ttf", BOLD: "DejaVuSans-Bold.ttf"}
#: Sizes of text and of cells, points, and spacing of lines.
TEXT, CELL = 8.0, 6.8
_SPACING = 1.2
#: Colors of rules, frames and notes, and of tones.
_RULE, FRAME, NOTE = "#cccccc", "#999999", "#555555"
BAD = "#c00000"
_COLORS = {"good": "#1a7f37", "near": "#9a6700", "far": "#8250df", "bad": BAD}
#: Space beside a cell, and above and below a table, points.
_BESIDE, _AROUND = 3.0, 6.0
#: Least number of rows of a table on a page, unless a row is taller, points.
_LEAST_ROWS, _TALL_ROW = 4, 100.0
#: Longest text of a value that is not wrapped, characters.
_LONGEST_VALUE = 24
#: Width of a word from which on it may be cut, points.
_LONGEST_WORD = 130.0
#: Share of its height below which a picture is not drawn on what remains of a page.
_LEAST_PICTURE = 0.5


@cache
def register_fonts() -> None:
    """Make the font known to ReportLab."""
    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    for name, file in _FILES.items():
        pdfmetrics.registerFont(TTFont(name, str(folder / file)))
    pdfmetrics.registerFontFamily(SANS, normal=SANS, bold=BOLD, italic=SANS, boldItalic=BOLD)


class _Text(Paragraph):
    """Paragraph whose longest word, up to `_LONGEST_WORD`, is not cut in a column of its width."""

    def minWidth(self) -> float:
        """Return the width of the longest word, above its rounding, points."""
        return min(float(super().minWidth()) + 0.01, _LONGEST_WORD)


def paragraph(
    text: str, size: float = TEXT, font: str = SANS, link: str = "", **style: Any
) -> Paragraph:
    """Return a text as a paragraph.

    link: `anchor` of the report that it links to, or ""
    style: fields of ReportLab's `ParagraphStyle`
    """
    marked = escape(printable(text))
    if link:
        marked = f'<a href="#{link}">{marked}</a>'
    look = {"fontName": font, "fontSize": size, "leading": _SPACING * size, "splitLongWords": 1}
    return _Text(marked, ParagraphStyle("", **look | style))


class Rows(Grid):
    """Table narrower than its room by more than a rounding, as two columns require."""

    def wrap(self, width: float, height: float) -> Any:
        """Return the size. A table of tall rows may be split after each, to fit on pages."""
        size = super().wrap(width - 0.01, height)
        if max(self._rowHeights) > _TALL_ROW:
            self._rowSplitRange = None
        return size

    def deepcopy(self) -> Rows:
        """Return a copy to be split, with the same cells, for the search of balanced columns."""
        return copy(self)


class _Column(NamedTuple):
    """Column of a table.

    cells: its heading and its cells
    natural: width with the longest cell on one line, points
    least: width with all words on lines of their own, and numbers on one line, points
    """

    cells: list[Paragraph]
    natural: float
    least: float


def tables(table: Table, notes: Sequence[str], room: float) -> Iterator[Rows]:
    """Yield a table, in blocks of columns that fit, with sentences below the last one.

    room: width of the page, points
    """
    columns = [
        _column(str(heading), [row[place] for row in table.rows], is_label=place == 0)
        for place, heading in enumerate(table.header)
    ]
    blocks = blocks_that_fit([column.least for column in columns], 1, room)
    for places in blocks:
        block = [columns[place] for place in places]
        rows = [*map(list, zip(*(column.cells for column in block), strict=True))]
        widths = _widths(block, room)
        below = notes if places is blocks[-1] else ()
        spans = [("SPAN", (0, -1 - place), (-1, -1 - place)) for place in range(len(below))]
        rows += [[paragraph(note, CELL), *[""] * (len(block) - 1)] for note in below]
        yield _grid(rows, widths, *spans)


def _column(heading: str, cells: Sequence[Any], is_label: bool) -> _Column:
    """Return a column of a table, wrapped between words if it contains labels or other words."""
    is_words = is_label or are_words(cells)
    side = TA_LEFT if is_words else TA_RIGHT
    shown = [paragraph(heading, CELL, BOLD, alignment=side)]
    for cell in cells:
        tone, link = getattr(cell, "tone", ""), getattr(cell, "link", "")
        color = _COLORS.get(tone, "black")
        shown.append(paragraph(str(cell), CELL, link=link, alignment=side, textColor=color))
    longest_cell = max(pdfmetrics.stringWidth(str(cell), SANS, CELL) for cell in ("", *cells))
    longest_cell += 0.01  # above its rounding
    least = max(each.minWidth() for each in shown)
    if not is_words:
        least = max(longest_cell, least)
    natural = max(longest_cell, least)
    return _Column(shown, natural + 2.0 * _BESIDE, least + 2.0 * _BESIDE)


def _widths(columns: Sequence[_Column], room: float) -> list[float]:
    """Return the widths of columns that fill a room as far as their contents need it, points."""
    least = sum(column.least for column in columns)
    more = sum(column.natural for column in columns) - least
    share = min(1.0, max(0.0, room - least) / more) if more else 0.0
    return [column.least + share * (column.natural - column.least) for column in columns]


def _grid(rows: list[list[Any]], widths: Sequence[Any], *rules: Any) -> Rows:
    """Return rows, of which the first is repeated on each page, as a table of ReportLab.

    widths: of each column: None for that of its contents, or a share "50%" of what is left
    rules: further style commands of ReportLab
    """
    look = [
        ("FONT", (0, 0), (-1, -1), SANS, CELL, _SPACING * CELL),
        ("TOPPADDING", (0, 0), (-1, -1), 0.7),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1.3),
        ("LEFTPADDING", (0, 0), (-1, -1), _BESIDE),
        ("RIGHTPADDING", (0, 0), (-1, -1), _BESIDE),
        ("LINEBELOW", (0, 1), (-1, -1), 0.4, _RULE),
        ("LINEBELOW", (0, 0), (-1, 0), 1.0, "black"),
        ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
        *rules,
    ]
    cut = (1 + _LEAST_ROWS, -_LEAST_ROWS) if len(rows) > 2 * _LEAST_ROWS + 1 else None
    return Rows(
        rows,
        widths,
        style=look,
        repeatRows=1,
        rowSplitRange=cut,
        hAlign="LEFT",
        spaceBefore=_AROUND,
        spaceAfter=_AROUND,
    )


def rows_of_group(group: Group) -> Iterator[Flowable]:
    """Yield a table of the rows of a group, name, value, unit and note, and its sentences."""
    if group.rows:
        rows: list[list[Any]] = [[paragraph(group.title, CELL, BOLD), "", "", ""]]
        for row in group.rows:
            name, value, unit, note = (printable(cell) for cell in row.cells())
            shown = value if len(value) <= _LONGEST_VALUE else paragraph(value, CELL)
            color = _COLORS.get(row.tone, NOTE)
            rows.append(
                [paragraph(name, CELL), shown, unit, paragraph(note, CELL, textColor=color)]
            )
        title, values = ("SPAN", (0, 0), (-1, 0)), ("ALIGN", (1, 1), (1, -1), "RIGHT")
        has_long_value = any(isinstance(value, Paragraph) for _, value, *_ in rows)
        widths = ["50%", "50%" if has_long_value else None, None, "50%"]
        yield _grid(rows, widths, title, values)
    for line in group.lines:
        yield paragraph(line, CELL, spaceAfter=2.0)


def drawing(picture: Picture, width: float, height: float) -> Iterator[Flowable]:
    """Yield a picture in its size, shrunk to the page or to what remains of it, of which at least
    half the height of the picture must remain.

    width, height: of a page, points
    """
    natural_width, natural_height = 72.0 * picture.figure.get_size_inches()
    room = min(natural_width, width), min(natural_height, height)
    image = Image(io.BytesIO(picture.png), *room, kind="proportional")
    yield CondPageBreak(_LEAST_PICTURE * image.drawHeight)
    yield KeepInFrame(width, 0, [image])
