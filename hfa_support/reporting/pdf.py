"""Reports as PDF documents: a sheet on a page, and books of sheets behind a cover."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from reportlab.lib.pagesizes import A4, landscape
from reportlab.lib.utils import simpleSplit
from reportlab.pdfgen.canvas import Canvas
from reportlab.platypus import (
    BalancedColumns,
    BaseDocTemplate,
    Flowable,
    Frame,
    NextPageTemplate,
    PageBreak,
    PageTemplate,
    Spacer,
    Table as Grid,
)
from reportlab.platypus.tableofcontents import TableOfContents

from hfa_support.errors import printable
from hfa_support.files import written_whole
from hfa_support.reporting.parts import BLANKS, SIGNERS, Contents, Picture
from hfa_support.reporting.pdf_parts import (
    BAD,
    BOLD,
    CELL,
    FRAME,
    NOTE,
    SANS,
    TEXT,
    drawing,
    paragraph,
    register_fonts,
    rows_of_group,
    tables,
)
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, flowing, is_warning

#: Margin of a page, and distance of its footer from the edge, points.
_MARGIN, _FOOT = 34.0, 18.0
#: Name of a page -> width and height, points.
_PAGES = {"portrait": A4, "landscape": landscape(A4)}
#: Sizes of headings by level, points.
_HEADINGS = (13.0, 11.0, 10.0)
#: Width of a label of a cover, height of a line to sign, and gap between columns, points.
_LABEL, _LINE, _GAP = 90.0, 26.0, 16.0
_IN_FRAMES = [("GRID", (0, 0), (-1, -1), 0.5, FRAME), ("VALIGN", (0, 0), (-1, -1), "TOP")]


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
        author=printable(report.head.get("document", "")),
        creator="hfa",
        invariant=True,  # equal results give equal files
    )
    names = (report.head.get(label, "") for label in ("document", "aircraft"))

    class Numbered(_NumberedPages):
        footer = printable(", ".join(filter(None, names)))
        issued = report.head.get("issued", "")

    build = document.multiBuild if report.is_book else document.build  # twice for page numbers
    build([*_story(report, 0)], canvasmaker=Numbered)
    with written_whole(path) as file:
        file.write(stream.getvalue())


class _Document(BaseDocTemplate):
    """Document whose contents have the page of each report."""

    def afterFlowable(self, flowable: Flowable) -> None:
        """Add a nested report to the contents, without what follows its name."""
        if isinstance(flowable, _Entry) and flowable.level:
            name = flowable.title.partition(": ")[0]
            self.notify("TOCEntry", (0, name, self.page, flowable.anchor or None))


def _page_template(name: str) -> PageTemplate:
    """Return the layout of a page of `_PAGES`, one frame within its margins."""
    frame = Frame(_MARGIN, _MARGIN, *_area(name), *(0.0,) * 4, id=name)
    return PageTemplate(name, [frame], pagesize=_PAGES[name])


def _area(name: str) -> tuple[float, float]:
    """Return width and height within the margins of a page, points."""
    width, height = _PAGES[name]
    return width - 2.0 * _MARGIN, height - 2.0 * _MARGIN


class _NumberedPages(Canvas):
    """Canvas that keeps its pages until it can number them, "3 of 14"."""

    footer = ""
    issued = ""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        if self.issued:  # the date of the document, "2026-11-30", in place of that of ReportLab
            day = *map(int, self.issued.split("-")), 0, 0, 0
            self._doc._timeStamp.YMDhms = day
        self.pages: list[dict[str, Any]] = []

    def showPage(self) -> None:
        """Keep a page."""
        self.pages.append({**self.__dict__})
        self._startPage()

    def save(self) -> None:
        """Write the pages with their numbers."""
        for number, page in enumerate(self.pages, start=1):
            self.__dict__.update(page)
            right = self._pagesize[0] - _MARGIN
            self.setFont(SANS, CELL)
            self.setFillColor(NOTE)
            self.drawRightString(right, _FOOT, f"{number} of {len(self.pages)}")
            first, *_ = simpleSplit(self.footer, SANS, CELL, 0.8 * right) or [""]
            self.drawString(_MARGIN, _FOOT, first)
            super().showPage()
        super().save()


def _story(report: Contents, level: int) -> Iterator[Flowable]:
    """Yield the parts of a report in reading order.

    level: depth of nesting, 0 for the document
    """
    yield from _heading(report, level)
    notes = (*(f"Note: {note}" for note in report.notes), *report.source.split("\n"))
    nested = [part for part in report.parts if isinstance(part, Contents)]
    others = [part for part in report.parts if not isinstance(part, Contents)]
    if nested:
        yield from _book(report.head, others, notes)
        for each in nested:
            yield PageBreak()
            yield from _story(each, level + 1)
        return
    if report.head:
        yield _framed(report.head)
        if level == 0:  # a sheet alone is signed, in a book the cover
            yield _framed(dict.fromkeys(BLANKS, ""), _LINE)
        yield Spacer(0.0, 6.0)
    if any(isinstance(part, Group) for part in others):
        yield from _sheet(others, notes, with_pictures=level == 0)
    else:
        for part in others:
            yield from _part(part, "portrait")
        yield from _small(notes)


def _heading(report: Contents, level: int) -> Iterator[Flowable]:
    """Yield the first line of the title as heading and in the outline, and the others below it."""
    first, _, others = flowing(report.title).partition("\n")
    if first:
        yield _Entry(printable(first), report.anchor, level)
        size = _HEADINGS[min(level, len(_HEADINGS) - 1)]
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
    return Grid([cells], ["*"] * len(cells), height, style=_IN_FRAMES)


def _book(
    head: Mapping[str, str], parts: Sequence[Any], notes: Sequence[str]
) -> Iterator[Flowable]:
    """Yield the first pages of a report of reports: the cover, and the other parts on wide pages.

    notes: notes and provenance, which are on the cover
    """
    if head:
        yield Spacer(0.0, 12.0)
        width = _area("portrait")[0]
        entries = [[paragraph(k, font=BOLD), paragraph(text)] for k, text in head.items()]
        yield Grid(entries, [_LABEL, width - _LABEL], style=_IN_FRAMES)
        yield Spacer(0.0, 18.0)
        columns = (width - _LABEL) / len(BLANKS)
        signed = [["", *BLANKS], *([signer, "", "", ""] for signer in SIGNERS)]
        heights = [None, *[_LINE] * len(SIGNERS)]
        bold = [*_IN_FRAMES, ("FONT", (0, 0), (-1, -1), BOLD, 8.0)]
        yield Grid(signed, [_LABEL, *[columns] * len(BLANKS)], heights, style=bold)
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
    elif part and isinstance(part[0], Table) and all(isinstance(each, str) for each in part[1:]):
        yield from tables(part[0], part[1:], width)
    else:
        for each in part:
            yield from _part(each, page)


def _sheet(parts: Sequence[Any], notes: Sequence[str], with_pictures: bool) -> Iterator[Flowable]:
    """Yield a sheet: its rows and sentences in two columns, then other tables and pictures.

    notes: notes and provenance
    with_pictures: whether pictures are drawn, which sheets in a book leave out
    """
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
    yield BalancedColumns(columns, innerPadding=_GAP, spaceAfter=6.0, **none)
    for part in below:
        yield from _part(part, "portrait")
