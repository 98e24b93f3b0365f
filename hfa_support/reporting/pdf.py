"""Reports as PDF."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import escape

import matplotlib
from reportlab.lib.enums import TA_LEFT, TA_RIGHT
from reportlab.lib.pagesizes import A4, landscape
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.utils import simpleSplit
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import (
    BalancedColumns,
    BaseDocTemplate,
    CondPageBreak,
    Flowable,
    Frame,
    Image,
    KeepInFrame,
    NextPageTemplate,
    PageBreak,
    PageTemplate,
    Paragraph,
    Spacer,
    Table as Grid,
)
from reportlab.platypus.tableofcontents import TableOfContents

from hfa_support.errors import printable
from hfa_support.files import written_whole
from hfa_support.reporting.parts import BLANKS, SIGNERS, Contents, Picture
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, are_words, blocks_that_fit, flowing, is_warning

#: Names of the font, and its files.
SANS, BOLD = "Sans", "Sans-Bold"
_FONT_FILES = {SANS: "DejaVuSans.ttf", BOLD: "DejaVuSans-Bold.ttf"}
#: Sizes of text and of cells, points, and spacing of lines.
TEXT, CELL = 8.0, 6.8
_LEADING = 1.2
#: Colors of rules, frames and notes, and of tones.
_RULE_COLOR, FRAME, NOTE = "#cccccc", "#999999", "#555555"
BAD = "#c00000"
_COLOR_OF_TONE = {"good": "#1a7f37", "near": "#9a6700", "far": "#8250df", "bad": BAD}
#: Space beside a cell, and above and below a table, points.
_CELL_PADDING, _TABLE_MARGIN = 3.0, 6.0
#: Least number of rows of a table on a page, unless a row is taller, points.
_LEAST_ROWS, _TALL_ROW_HEIGHT = 4, 100.0
#: Longest text of a value that is not wrapped, characters.
_LONGEST_VALUE = 24
#: Width of a word from which on it may be cut, points.
_LONGEST_WORD = 130.0
#: Share of its height below which a picture is not drawn on what remains of a page.
_LEAST_PICTURE_SHARE = 0.5


@cache
def register_fonts() -> None:
    """Make the font known to ReportLab."""
    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    for name, file in _FONT_FILES.items():
        pdfmetrics.registerFont(TTFont(name, str(folder / file)))
    pdfmetrics.registerFontFamily(SANS, normal=SANS, bold=BOLD, italic=SANS, boldItalic=BOLD)


class _Text(Paragraph):
    """Paragraph that is at least as wide as its longest word, so that words up to `_LONGEST_WORD`
    are not cut.
    """

    def minWidth(self) -> float:
        """Return the width of the longest word with its rounding, points."""
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
    look = {"fontName": font, "fontSize": size, "leading": _LEADING * size, "splitLongWords": 1}
    return _Text(marked, ParagraphStyle("", **look | style))


class Rows(Grid):
    """Table that is narrower than its room by more than a rounding: `BalancedColumns` would refuse
    it.
    """

    def wrap(self, width: float, height: float) -> Any:
        """Return width and height. A table of tall rows may be split after any row, to fit on
        pages.
        """
        size = super().wrap(width - 0.01, height)  # points, more than a rounding
        if max(self._rowHeights) > _TALL_ROW_HEIGHT:
            # ReportLab's range of rows after which it may split the table: None permits all.
            self._rowSplitRange = None
        return size

    def deepcopy(self) -> Rows:
        """Return a copy with the same cells, which `BalancedColumns` splits for equal heights."""
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
        below = notes if places is blocks[-1] else ()
        spans = [("SPAN", (0, -1 - place), (-1, -1 - place)) for place in range(len(below))]
        rows += [[paragraph(note, CELL), *[""] * (len(block) - 1)] for note in below]
        yield _grid(rows, _widths(block, room), *spans)


def _column(heading: str, cells: Sequence[Any], is_label: bool) -> _Column:
    """Return a column of a table. Labels and words may be wrapped, and numbers not.

    is_label: whether the column names the rows
    """
    is_words = is_label or are_words(cells)
    side = TA_LEFT if is_words else TA_RIGHT
    shown = [paragraph(heading, CELL, BOLD, alignment=side)]
    for cell in cells:
        tone, link = getattr(cell, "tone", ""), getattr(cell, "link", "")
        color = _COLOR_OF_TONE.get(tone, "black")
        shown.append(paragraph(str(cell), CELL, link=link, alignment=side, textColor=color))
    longest_cell = max(pdfmetrics.stringWidth(str(cell), SANS, CELL) for cell in ("", *cells))
    longest_cell += 0.01  # above its rounding
    least = max(flowable.minWidth() for flowable in shown)
    if not is_words:
        least = max(longest_cell, least)
    natural = max(longest_cell, least)
    return _Column(shown, natural + 2.0 * _CELL_PADDING, least + 2.0 * _CELL_PADDING)


def _widths(columns: Sequence[_Column], room: float) -> list[float]:
    """Return the widths of columns, points: each column has its least width and, as far as the room
    permits, the same share of its difference from the natural width.
    """
    least = sum(column.least for column in columns)
    more = sum(column.natural for column in columns) - least
    share = min(1.0, max(0.0, room - least) / more) if more else 0.0
    return [column.least + share * (column.natural - column.least) for column in columns]


def _grid(rows: list[list[Any]], widths: Sequence[Any], *rules: Any) -> Rows:
    """Return rows as a table of ReportLab. The first row is repeated on each page.

    rules: further styles of its cells
    """
    look = [
        ("FONT", (0, 0), (-1, -1), SANS, CELL, _LEADING * CELL),
        ("TOPPADDING", (0, 0), (-1, -1), 0.7),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1.3),
        ("LEFTPADDING", (0, 0), (-1, -1), _CELL_PADDING),
        ("RIGHTPADDING", (0, 0), (-1, -1), _CELL_PADDING),
        ("LINEBELOW", (0, 1), (-1, -1), 0.4, _RULE_COLOR),
        ("LINEBELOW", (0, 0), (-1, 0), 1.0, "black"),
        ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
        *rules,
    ]
    # ReportLab may split the table after these rows, so that a page has at least `_LEAST_ROWS`.
    split_range = (1 + _LEAST_ROWS, -_LEAST_ROWS) if len(rows) > 2 * _LEAST_ROWS + 1 else None
    return Rows(
        rows,
        widths,
        style=look,
        repeatRows=1,
        rowSplitRange=split_range,
        hAlign="LEFT",
        spaceBefore=_TABLE_MARGIN,
        spaceAfter=_TABLE_MARGIN,
    )


def rows_of_group(group: Group) -> Iterator[Flowable]:
    """Yield a table of the rows of a group, name, value, unit and note, and its sentences."""
    if group.rows:
        rows: list[list[Any]] = [[paragraph(group.title, CELL, BOLD), "", "", ""]]
        for row in group.rows:
            name, value, unit, note = (printable(cell) for cell in row.cells())
            shown = value if len(value) <= _LONGEST_VALUE else paragraph(value, CELL)
            color = _COLOR_OF_TONE.get(row.tone, NOTE)
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
    """Yield a picture in its size, shrunk to the page. If a page has room for at least half its
    height, the picture is shrunk further to this room; otherwise the picture is drawn on the next
    page.

    width, height: of a page, points
    """
    natural_width, natural_height = 72.0 * picture.figure.get_size_inches()
    room = min(natural_width, width), min(natural_height, height)
    image = Image(io.BytesIO(picture.png), *room, kind="proportional")
    yield CondPageBreak(_LEAST_PICTURE_SHARE * image.drawHeight)
    yield KeepInFrame(width, 0, [image])  # height 0: all that is left on the page


#: Margin of a page, distance of its footer from the edge, and width of the number of pages, points.
_PAGE_MARGIN, _FOOTER_HEIGHT, _TOTAL_WIDTH = 34.0, 18.0, 12.0
#: Name of a page -> width and height, points.
_PAGES = {"portrait": A4, "landscape": landscape(A4)}
#: Sizes of headings by level, points.
_HEADING_SIZES = (13.0, 11.0, 10.0)
#: Width of a label of a cover, height of a line to sign, and gap between columns, points.
_LABEL_WIDTH, _SIGNATURE_HEIGHT, _COLUMN_GAP = 90.0, 26.0, 16.0
_FRAME_STYLE = [("GRID", (0, 0), (-1, -1), 0.5, FRAME), ("VALIGN", (0, 0), (-1, -1), "TOP")]


def write_pdf(report: Contents, path: Path) -> None:
    """Write a report as PDF, completely or not at all.

    A sheet has one page if it fits. A report of reports has its head as cover, its tables on wide
    pages, and each report on pages of its own.
    """
    register_fonts()
    stream = io.BytesIO()
    document = _Document(
        stream,
        pageTemplates=[*map(_page_template, _PAGES)],
        title=printable(report.title.partition("\n")[0]),
        subject=printable(report.head.get("document", "")),
        creator="hfa",
        invariant=True,  # equal results give equal files
    )
    names = (report.head.get(label, "") for label in ("document", "aircraft"))

    class Numbered(_NumberedPages):  # ReportLab makes the canvas without further arguments
        footer = printable(", ".join(filter(None, names)))
        issued = report.head.get("issued", "")

    build = document.multiBuild if report.is_book else document.build  # twice for page numbers
    build([*_story(report, 0)], canvasmaker=Numbered)
    with written_whole(path) as file:
        file.write(stream.getvalue())


class _Document(BaseDocTemplate):
    """Document whose contents have the page of each report."""

    def afterFlowable(self, flowable: Flowable) -> None:
        """Add the title of a nested report, up to a colon, to the contents."""
        if isinstance(flowable, _Entry) and flowable.level:
            name = flowable.title.partition(": ")[0]
            self.notify("TOCEntry", (0, name, self.page, flowable.anchor or None))


def _page_template(name: str) -> PageTemplate:
    """Return the layout of a page of `_PAGES`, one frame within its margins."""
    frame = Frame(_PAGE_MARGIN, _PAGE_MARGIN, *_area(name), *(0.0,) * 4, id=name)
    return PageTemplate(name, [frame], pagesize=_PAGES[name])


def _area(name: str) -> tuple[float, float]:
    """Return width and height within the margins of a page, points."""
    width, height = _PAGES[name]
    return width - 2.0 * _PAGE_MARGIN, height - 2.0 * _PAGE_MARGIN


class _NumberedPages(Canvas):
    """Canvas that numbers its pages, "3 of 14"; the last number is drawn when all are known."""

    footer = ""
    issued = ""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        if self.issued:  # the date of the document, "2026-11-30", in place of that of ReportLab
            day = *map(int, self.issued.split("-")), 0, 0, 0
            self._doc._timeStamp.YMDhms = day

    def showPage(self) -> None:
        """Draw the footer, and end the page."""
        right = self._pagesize[0] - _PAGE_MARGIN - _TOTAL_WIDTH
        self.setFont(SANS, CELL)
        self.setFillColor(NOTE)
        self.drawRightString(right, _FOOTER_HEIGHT, f"{self.getPageNumber()} of ")
        self.translate(right, _FOOTER_HEIGHT)
        self.doForm("total")
        self.translate(-right, -_FOOTER_HEIGHT)
        # The first line of the footer that leaves room for the page number.
        first, *_ = simpleSplit(self.footer, SANS, CELL, 0.8 * right) or [""]
        self.drawString(_PAGE_MARGIN, _FOOTER_HEIGHT, first)
        super().showPage()

    def save(self) -> None:
        """Write the document with the number of its pages."""
        total = self.getPageNumber() - 1
        self.beginForm("total")
        self.setFont(SANS, CELL)
        self.setFillColor(NOTE)
        self.drawString(0.0, 0.0, str(total))
        self.endForm()
        super().save()


def _story(report: Contents, level: int) -> Iterator[Flowable]:
    """Yield the parts of a report in reading order."""
    yield from _heading(report, level)
    notes = (*(f"Note: {note}" for note in report.notes), *report.source.split("\n"))
    nested = [part for part in report.parts if isinstance(part, Contents)]
    others = [part for part in report.parts if not isinstance(part, Contents)]
    if nested:
        yield from _book(report.head, others, notes)
        for inner_report in nested:
            yield PageBreak()
            yield from _story(inner_report, level + 1)
        return
    if report.head:
        yield _framed(report.head)
        if level == 0:  # a sheet alone is signed, in a book the cover
            yield _framed(dict.fromkeys(BLANKS, ""), _SIGNATURE_HEIGHT)
        yield Spacer(0.0, 6.0)
    if any(isinstance(part, Group) for part in others):
        yield from _sheet(others, notes, with_pictures=level == 0)
    else:
        for part in others:
            yield from _part(part, "portrait")
        yield from _small(notes)


def _heading(report: Contents, level: int) -> Iterator[Flowable]:
    """Yield the first line of the title as heading and entry of the outline, and the other lines
    below.
    """
    first, _, others = flowing(report.title).partition("\n")
    if first:
        yield _Entry(printable(first), report.anchor, level)
        size = _HEADING_SIZES[min(level, len(_HEADING_SIZES) - 1)]
        yield paragraph(first, size, BOLD, spaceAfter=0.3 * size, keepWithNext=1)
    yield from _lines(others)


class _Entry(Flowable):
    """Entry of the outline of a document, without a size on the page."""

    def __init__(self, title: str, anchor: str, level: int) -> None:
        super().__init__()
        self.title = title
        self.anchor = anchor
        self.level = level

    def draw(self) -> None:
        """Add the entry to the outline, and the bookmark to which cells of tables link."""
        key = self.anchor or f"{self.canv.getPageNumber()} {self.title}"
        self.canv.bookmarkHorizontal(key, 0.0, 20.0)
        self.canv.addOutlineEntry(self.title, key, self.level)


def _lines(text: str) -> Iterator[Flowable]:
    """Yield the lines of a text, warnings in bold."""
    for line in filter(str.strip, text.split("\n")):
        font, color = (BOLD, BAD) if is_warning(line) else (SANS, "black")
        yield paragraph(line, TEXT, font, textColor=color, spaceAfter=2.0)


def _small(lines: Sequence[str]) -> Iterator[Flowable]:
    """Yield lines in the size and color of notes."""
    for line in filter(None, lines):
        yield paragraph(line, CELL, textColor=NOTE, spaceBefore=3.0)


def _framed(entries: Mapping[str, str], height: float | None = None) -> Grid:
    """Return entries, label -> text, in frames beside each other."""
    cells = [
        [paragraph(label, CELL, BOLD), paragraph(text, CELL)] for label, text in entries.items()
    ]
    return Grid([cells], ["*"] * len(cells), height, style=_FRAME_STYLE)


def _book(
    head: Mapping[str, str], parts: Sequence[Any], notes: Sequence[str]
) -> Iterator[Flowable]:
    """Yield the cover, with notes and provenance, and the other parts on wide pages."""
    if head:
        yield Spacer(0.0, 12.0)
        width = _area("portrait")[0]
        entries = [[paragraph(k, font=BOLD), paragraph(text)] for k, text in head.items()]
        yield Grid(entries, [_LABEL_WIDTH, width - _LABEL_WIDTH], style=_FRAME_STYLE)
        yield Spacer(0.0, 18.0)
        columns = (width - _LABEL_WIDTH) / len(BLANKS)
        signed = [["", *BLANKS], *([signer, "", "", ""] for signer in SIGNERS)]
        heights = [None, *[_SIGNATURE_HEIGHT] * len(SIGNERS)]
        bold = [*_FRAME_STYLE, ("FONT", (0, 0), (-1, -1), BOLD, 8.0)]
        yield Grid(signed, [_LABEL_WIDTH, *[columns] * len(BLANKS)], heights, style=bold)
        yield Spacer(0.0, 12.0)
    yield from _small(notes)
    if head:
        style = paragraph("").style
        contents = TableOfContents(dotsMinLevel=0, levelStyles=[style])
        yield Spacer(0.0, 12.0)
        yield contents
    if parts:
        yield NextPageTemplate("landscape")
        if head:
            yield PageBreak()
        for part in parts:
            yield from _part(part, "landscape")
        yield NextPageTemplate("portrait")


def _part(part: Any, page: str) -> Iterator[Flowable]:
    """Yield a paragraph, a table with sentences below it, a tuple of such parts, or a picture."""
    width, height = _area(page)
    if isinstance(part, Picture):
        yield from drawing(part, width, height)
    elif isinstance(part, str):
        yield from _lines(flowing(part))
    elif isinstance(part, Table):
        yield from _part((part,), page)
    elif part and isinstance(part[0], Table) and all(isinstance(text, str) for text in part[1:]):
        yield from tables(part[0], part[1:], width)
    else:
        for nested in part:
            yield from _part(nested, page)


def _sheet(parts: Sequence[Any], notes: Sequence[str], with_pictures: bool) -> Iterator[Flowable]:
    """Yield a sheet: its rows and sentences in two columns, then other tables and pictures."""
    columns: list[Flowable] = []
    below = []
    for part in parts:
        lines = part if isinstance(part, tuple) and not isinstance(part, Table) else (part,)
        if isinstance(part, Group):
            columns += rows_of_group(part)
        elif all(isinstance(line, str) for line in lines):
            columns += _small(lines)
        elif with_pictures or not isinstance(part, Picture):
            below.append(part)
    columns += _small(notes)
    none = dict.fromkeys(("leftPadding", "rightPadding", "topPadding", "bottomPadding"), 0.0)
    yield BalancedColumns(columns, innerPadding=_COLUMN_GAP, spaceAfter=6.0, **none)
    for part in below:
        yield from _part(part, "portrait")
