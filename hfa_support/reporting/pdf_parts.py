"""Parts of PDF documents: paragraphs, tables, the two columns of a sheet, pictures. The layout is
ReportLab's, the font DejaVu Sans, which is part of matplotlib and has Greek letters and signs.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias
from xml.sax.saxutils import escape

import matplotlib
from reportlab.lib.enums import TA_LEFT, TA_RIGHT
from reportlab.lib.styles import ParagraphStyle
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase import pdfmetrics
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.platypus import Flowable, PageBreak, Paragraph, Table as Grid

from hfa_support.reporting.parts import Picture
from hfa_support.reporting.rows import Group, Row
from hfa_support.reporting.text import Table, are_words, printable

#: Names of the font, and its files.
SANS, BOLD = "Sans", "Sans-Bold"
_FILES = {SANS: "DejaVuSans.ttf", BOLD: "DejaVuSans-Bold.ttf"}
#: Sizes of text and of cells, points, and spacing of lines.
TEXT, CELL = 8.0, 7.2
_SPACING = 1.25
#: Colors of rules, frames and notes, and of tones.
RULE, FRAME, NOTE = "#cccccc", "#999999", "#555555"
BAD = "#c00000"
_COLORS = {"good": "#1a7f37", "near": "#9a6700", "far": "#8250df", "bad": BAD}
#: Gap between two columns, space beside a cell and between groups, points.
GAP, _BESIDE, _BETWEEN = 16.0, 3.0, 6.0
#: Both spaces beside a cell, and the rounding of a width.
_PADDING = 2.0 * _BESIDE + 0.1
#: Both spaces beside a cell in a frame.
_FRAMED = 12.1
#: Scales that bring a sheet onto one page, largest first.
_SCALES = (1.0, 0.96, 0.92)
#: Share of a page above which a group continues in the next column, and least rows of a part.
_HIGHEST_GROUP = 0.8
_LEAST_ROWS = 4
#: Share of a column for a value, above which it is wrapped.
_LARGEST_VALUE = 0.5
#: Share of a page that is left only at its beginning.
_WHOLE = 0.95
#: Share of its size below which a picture is not drawn on what remains of a page.
_LEAST_PICTURE = 0.45


@cache
def register_fonts() -> None:
    """Make the font known to ReportLab."""
    folder = Path(matplotlib.get_data_path(), "fonts", "ttf")
    for name, file in _FILES.items():
        pdfmetrics.registerFont(TTFont(name, str(folder / file)))
    pdfmetrics.registerFontFamily(SANS, normal=SANS, bold=BOLD, italic=SANS, boldItalic=BOLD)


def text_width(text: str, font: str = SANS, size: float = CELL) -> float:
    """Return the width of a text, points."""
    return float(pdfmetrics.stringWidth(text, font, size))


def paragraph(text: str, size: float = TEXT, font: str = SANS, **style: Any) -> Paragraph:
    """Return a text as a paragraph.

    style: fields of ReportLab's `ParagraphStyle`
    """
    return _marked(escape(printable(text, lines=False)), size, font, **style)


def labelled(label: str, text: str, size: float = CELL) -> Paragraph:
    """Return a paragraph with a label in bold above its text."""
    shown = (escape(printable(each, lines=False)) for each in (label, text))
    return _marked("<b>{}</b><br/>{}".format(*shown), size, SANS)


def _marked(text: str, size: float, font: str, **style: Any) -> Paragraph:
    look = {"fontName": font, "fontSize": size, "leading": _SPACING * size, "splitLongWords": 1}
    return Paragraph(text, ParagraphStyle("", **look | style))


class Rows(Grid):
    """Table with at least `_LEAST_ROWS` rows on each page."""

    def split(self, width: float, height: float) -> list[Any]:
        """Return the part that fits in a height, and the rest."""
        parts: list[Any] = super().split(width, height)
        if len(parts) == 2:
            few = _LEAST_ROWS + self.repeatRows - parts[1]._nrows
            last = parts[0]._nrows
            if few > 0 and last - few > _LEAST_ROWS:
                shorter = sum(self._rowHeights[: last - few]) + 0.01
                first, rest = super().split(width, shorter)
                return [first, PageBreak(), rest]
        return parts


def _look(*rules: Any) -> list[Any]:
    return [
        ("FONT", (0, 0), (-1, -1), SANS, CELL, _SPACING * CELL),
        ("TOPPADDING", (0, 0), (-1, -1), 0.7),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 1.3),
        ("LEFTPADDING", (0, 0), (-1, -1), _BESIDE),
        ("RIGHTPADDING", (0, 0), (-1, -1), _BESIDE),
        ("LINEBELOW", (0, 1), (-1, -1), 0.4, RULE),
        ("LINEBELOW", (0, 0), (-1, 0), 1.0, "black"),
        ("VALIGN", (0, 0), (-1, -1), "MIDDLE"),
        *rules,
    ]


class _Column(NamedTuple):
    """Column of a table.

    heading: its heading
    cells: texts of its cells, and their tones and links
    is_words: whether it is aligned left, and may be wrapped
    natural: width without wrapped cells, points
    least: least width, points
    """

    heading: str
    cells: list[str]
    tones: list[str]
    links: list[str]
    is_words: bool
    natural: float
    least: float


def _column(table: Table, index: int, room: float) -> _Column:
    """Return a column of a table. A word is cut where it is wider than a quarter of the room."""
    given = [row[index] for row in table.rows]
    cells = [printable(str(cell), lines=False) for cell in given]
    heading = str(table.header[index])
    is_words = index == 0 or are_words(cells)
    words = (word for cell in cells for word in cell.split())
    longest = min(max(map(text_width, words), default=0.0), 0.25 * room)
    natural = max(map(text_width, cells), default=0.0)
    above = max((text_width(word, BOLD) for word in heading.split()), default=0.0)
    least = max(above, longest if is_words else natural) + _PADDING
    tones, links = ([getattr(cell, kind, "") for cell in given] for kind in ("tone", "link"))
    return _Column(heading, cells, tones, links, is_words, max(natural + _PADDING, least), least)


def tables(table: Table, notes: Sequence[str], room: float) -> Iterator[Rows]:
    """Yield a table, in blocks of columns that fit, with sentences below the last one.

    room: width of the page, points
    """
    columns = [_column(table, index, room) for index in range(len(table.header))]
    blocks = _blocks_that_fit(columns, room)
    for block in blocks:
        yield _grid(block, notes if block is blocks[-1] else (), room)


def _grid(columns: Sequence[_Column], notes: Sequence[str], room: float) -> Rows:
    """Return columns as a table with sentences below it."""
    widths = _shared([each.natural for each in columns], [each.least for each in columns], room)
    header = [
        paragraph(column.heading, CELL, BOLD, alignment=TA_LEFT if column.is_words else TA_RIGHT)
        for column in columns
    ]
    shown = [
        [
            _linked(text, link) if link else _fitted(text, tone, width)
            for text, tone, link in zip(column.cells, column.tones, column.links, strict=True)
        ]
        for column, width in zip(columns, widths, strict=True)
    ]
    rows = [header, *map(list, zip(*shown, strict=True))]
    rules: list[Any] = []
    for place, column in enumerate(columns):
        rules.append(("ALIGN", (place, 0), (place, -1), "LEFT" if column.is_words else "RIGHT"))
        for row, tone in enumerate(column.tones, start=1):
            if tone:
                rules.append(("TEXTCOLOR", (place, row), (place, row), _COLORS[tone]))
    for note in notes:
        rules.append(("SPAN", (0, len(rows)), (-1, len(rows))))
        rows.append([paragraph(note, CELL), *[""] * (len(columns) - 1)])
    look = _look(*rules)
    return Rows(rows, widths, style=look, repeatRows=1, hAlign="LEFT", spaceAfter=_BETWEEN)


def _fitted(text: str, tone: str, width: float) -> Any:
    """Return the text of a cell, as a paragraph where it is wider than the cell."""
    color = _COLORS.get(tone, "black")
    return text if _fits(text, width) else paragraph(text, CELL, textColor=color)


def _linked(text: str, link: str) -> Paragraph:
    """Return the text of a cell that links to a report."""
    return _marked(f'<a href="#{link}">{escape(text)}</a>', CELL, SANS)


def _fits(text: str, width: float) -> bool:
    return text_width(text) + 2.0 * _BESIDE <= width


def label_widths(entries: Mapping[str, str], room: float) -> list[float]:
    """Return the widths of frames with entries, label -> text, which fill a room."""
    natural, least = [], []
    for label, text in entries.items():
        name = text_width(label, BOLD)
        words = max(map(text_width, text.split()), default=0.0)
        natural.append(max(name, text_width(text)) + _FRAMED)
        least.append(max(name, min(words, room / len(entries) - _FRAMED)) + _FRAMED)
    widths = _shared(natural, least, room)
    rest = max(0.0, room - sum(widths)) / len(widths)
    return [width + rest for width in widths]


def _blocks_that_fit(columns: Sequence[_Column], room: float) -> list[list[_Column]]:
    """Return the columns of each block, of which each begins with the first column."""
    blocks = [[columns[0]]]
    for column in columns[1:]:
        used = sum(each.least for each in blocks[-1])
        if len(blocks[-1]) > 1 and used + column.least > room:
            blocks.append([columns[0]])
        blocks[-1].append(column)
    return blocks


def _shared(natural: Sequence[float], least: Sequence[float], room: float) -> list[float]:
    """Return widths between the least and the natural ones that fit in a room."""
    wanted = sum(natural) - sum(least)
    share = min(1.0, max(0.0, room - sum(least)) / wanted) if wanted else 0.0
    return [low + share * (high - low) for high, low in zip(natural, least, strict=True)]


#: Parts of a group, each with its height, points.
_Block: TypeAlias = list[tuple[Any, float]]


class Columns(Flowable):
    """Groups of rows in two columns of about equal height, in reading order, a little smaller where
    they fit on the page then.
    """

    def __init__(
        self, groups: Sequence[Group], made: Mapping[float, Sequence[_Block]] | None = None
    ) -> None:
        """Keep the groups.

        made: width of a column -> their blocks, as far as they were made before
        """
        super().__init__()
        self.groups = groups
        self.made = dict(made or {})
        self.spaceAfter = _BETWEEN

    def _blocks(self, column: float) -> Sequence[_Block]:
        """Return the blocks of all groups in a column of a width."""
        if column not in self.made:
            self.made[column] = [_block(group, column) for group in self.groups]
        return self.made[column]

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        """Return the size at the largest scale that fits, or at full scale."""
        for self.scale in (*_SCALES, _SCALES[0]):
            self.column = (width / self.scale - GAP) / 2.0
            self.blocks = self._blocks(self.column)
            self.count, self.height = _balanced([*map(_height, self.blocks)])
            if self.scale * self.height <= height:
                break
        return width, self.scale * self.height

    def split(self, width: float, height: float) -> list[Any]:
        """Return what fits in a height, and the rest."""
        heights = [*map(_height, self._blocks((width - GAP) / 2.0))]
        left = _fitting(heights, height)
        count = left + _fitting(heights[left:], height)
        if not count:
            return []
        return [
            Columns(self.groups[part], {width: blocks[part] for width, blocks in self.made.items()})
            for part in (slice(count), slice(count, None))
            if self.groups[part]
        ]

    def draw(self) -> None:
        """Draw both columns."""
        self.canv.saveState()
        self.canv.scale(self.scale, self.scale)
        columns = (self.blocks[: self.count], self.blocks[self.count :])
        for left, blocks in zip((0.0, self.column + GAP), columns, strict=True):
            top = self.height
            for block in blocks:
                for part, height in block:
                    part.drawOn(self.canv, left, top - height)
                    top -= height
                top -= _BETWEEN
        self.canv.restoreState()


def columns_of(groups: Sequence[Group], width: float, height: float) -> Columns:
    """Return groups in two columns; those higher than most of a page are cut.

    width: width of the page, points
    height: its height, points
    """
    cut: list[Group] = []
    for group in groups:
        whole = _height(_block(group, (width - GAP) / 2.0))
        count = int(whole / (_HIGHEST_GROUP * height)) + 1
        size = -(-len(group.rows) // count)
        for first in range(0, len(group.rows) or 1, size or 1):
            title = f"{group.title} (continued)" if first else group.title
            is_last = first + size >= len(group.rows)
            lines = group.lines if is_last else ()
            cut.append(Group(title, group.rows[first : first + size], lines))
    return Columns(cut)


def _height(block: _Block) -> float:
    return sum(height for _, height in block) + _BETWEEN


def _balanced(heights: Sequence[float]) -> tuple[int, float]:
    """Return the number of blocks in the first column, and the height of the higher column."""
    ways = [
        (max(sum(heights[:count]), sum(heights[count:])), count)
        for count in range(1, len(heights) + 1)
    ]
    height, count = min(ways)
    return count, height


def _fitting(heights: Sequence[float], height: float) -> int:
    """Return the number of first blocks that fit in a height."""
    count, total = 0, 0.0
    while count < len(heights) and total + heights[count] <= height:
        total += heights[count]
        count += 1
    return count


def _block(group: Group, width: float) -> _Block:
    """Return the table of a group and its sentences, each with its height, points."""
    parts: list[Any] = [_group_table(group, width)] if group.rows else []
    parts += [paragraph(line, CELL) for line in group.lines]
    return [(part, part.wrap(width, 1e6)[1]) for part in parts]


def _group_table(group: Group, width: float) -> Rows:
    """Return the rows of a group as a table: title above, name, value, unit and note."""
    cells = [[printable(cell, lines=False) for cell in row.cells()] for row in group.rows]
    room = _LARGEST_VALUE * width
    names, values, units, notes = (
        [text_width(row[i]) + _PADDING for row in cells] for i in range(4)
    )
    value = max((each for each in values if each <= room), default=_PADDING)
    unit = max(units)
    rest = width - value - unit
    name = max(min(max(names), rest - min(max(notes), 0.5 * rest)), 0.25 * rest)
    widths = [name, value, unit, rest - name]
    body: list[list[Any]] = [[paragraph(group.title, CELL, BOLD), "", "", ""]]
    rules: list[Any] = [
        ("SPAN", (0, 0), (-1, 0)),
        ("ALIGN", (1, 1), (1, -1), "RIGHT"),
        ("TEXTCOLOR", (3, 1), (3, -1), NOTE),
    ]
    for number, (row, shown) in enumerate(zip(group.rows, cells, strict=True), start=1):
        body.append(_cells(row, shown, widths))
        if not _fits(shown[1], value):
            rules.append(("SPAN", (1, number), (3, number)))
        if row.tone:
            rules.append(("TEXTCOLOR", (3, number), (3, number), _COLORS[row.tone]))
    return Rows(body, widths, style=_look(*rules), repeatRows=1)


def _cells(row: Row, shown: Sequence[str], widths: Sequence[float]) -> list[Any]:
    """Return the cells of a row. A long value has the room of unit and note."""
    name, value, unit, note = shown
    called = _fitted(name, "", widths[0])
    if not _fits(value, widths[1]):
        whole = " ".join(filter(None, (value, unit, note)))
        return [called, paragraph(whole, CELL), "", ""]
    color = _COLORS.get(row.tone, NOTE)
    noted = note if _fits(note, widths[3]) else paragraph(note, CELL, textColor=color)
    return [called, value, unit, noted]


class Drawing(Flowable):
    """Picture as large as the page, or a little smaller where it fits in what remains then."""

    def __init__(self, picture: Picture, page: float, is_optional: bool) -> None:
        """Keep the picture.

        page: height of a page, points
        is_optional: whether the picture is left out where it does not fit
        """
        super().__init__()
        self.picture = picture
        self.page = page
        self.is_optional = is_optional

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        """Return the size."""
        own_width, own_height = (72.0 * inches for inches in self.picture.figure.get_size_inches())
        scale = min(1.0, width / own_width, self.page / own_height)
        room = height / (scale * own_height)
        if _LEAST_PICTURE <= room < 1.0:
            scale *= room
        elif self.is_optional and (room < 1.0 or height > _WHOLE * self.page):
            scale = 0.0
        self.size = scale * own_width, scale * own_height
        return self.size

    def draw(self) -> None:
        """Draw the picture."""
        if self.size[1]:
            self.canv.drawImage(ImageReader(io.BytesIO(self.picture.png)), 0, 0, *self.size)
