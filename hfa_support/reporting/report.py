"""A report: what a result says, once, as text for a terminal, Markdown, HTML, and data for
files."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from hfa_support.reporting.text import Cell, Table, columns, printable, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NO_RECORDS = Table((), ())
#: Of the files that `Report.save` writes.
SUFFIXES = (".json", ".npz", ".mat", ".csv")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure that is drawn when somebody looks at it; `text` says what it shows to those who
    cannot see it."""

    name: str
    text: str
    draw: Callable[[], Figure]

    @cached_property
    def png(self) -> bytes:
        """The figure as PNG, drawn once."""
        from hfa_support.reporting.figure import png_bytes

        return png_bytes(self.draw())

    def html(self) -> str:
        """The figure with its text below it, embedded."""
        data = base64.b64encode(self.png).decode("ascii")
        text = _escaped(self.text)
        image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """What a result says, in the order in which it is read.

    title: a heading, and below it what follows its first line
    parts: paragraphs (str), tables of formatted cells (Table), a tuple of these without an empty
        line between them, pictures, and reports within the report
    notes: what to know before trusting it
    data: the result for JSON, .npz and .mat
    records: for CSV, numbers with all digits
    source: the provenance, shown last
    """

    title: str
    parts: Sequence[Part] = ()
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    records: Table = NO_RECORDS
    source: str = ""

    def __repr__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        return self.html(level=3)

    def with_data(self, **more: Any) -> Report:
        """The same report with more data."""
        return replace(self, data={**self.data, **more})

    def text(self, color: bool = False, width: int | None = None) -> str:
        """For a terminal: parts with an empty line between them, without pictures.

        color: of cells with a tone
        width: of the terminal, in characters; None for lines as long as they are
        """
        shown = [_text(part, color, width) for part in self.parts if not isinstance(part, Picture)]
        notes = (f"Note: {note}" for note in self.notes)
        title, *after = (
            wrapped(printable(text), width) for text in (self.title, *notes, self.source)
        )
        return "\n\n".join(filter(None, [title, *shown, *after]))

    def markdown(self, level: int = 1) -> str:
        """With headings from `level` on, without pictures."""
        shown = [_markdown(part, level) for part in self.parts if not isinstance(part, Picture)]
        first, *others = printable(self.title).split("\n")
        heading = [f"{'#' * level} {first}"] if first else []
        notes = (printable(f"Note: {note}") for note in self.notes)
        return "\n\n".join(filter(None, [*heading, *others, *shown, *notes, self.source]))

    def html(self, level: int = 1) -> str:
        """A fragment without styles, every word escaped; pictures embedded, nothing loaded from
        elsewhere."""
        first, *others = self.title.split("\n")
        heading = [f"<h{level}>{_escaped(first)}</h{level}>"] if first else []
        shown = [_html(part, level) for part in self.parts]
        notes = (*(f"Note: {note}" for note in self.notes), *filter(None, self.source.split("\n")))
        return "\n".join([*heading, *map(_paragraph, others), *shown, *map(_paragraph, notes)])

    def json(self) -> str:
        """The data; a number that is not finite becomes null."""
        from hfa_support.jsonable import json_text

        return json_text(self.data).rstrip()

    def save(self, path: Path) -> None:
        """Data (.json, .npz, .mat) or records (.csv) as one file, whole or not at all, numbers with
        all digits."""
        from hfa_support.reporting.data_files import save_data

        save_data(path, self.data, self.records)

    def without_pictures(self) -> Report:
        """The same report without the pictures among its parts."""
        return replace(self, parts=[part for part in self.parts if not isinstance(part, Picture)])

    def pictures(self) -> Iterator[Picture]:
        """All pictures, those of the reports within it too."""
        for part in self.parts:
            if isinstance(part, Picture):
                yield part
            elif isinstance(part, Report):
                yield from part.pictures()


Part: TypeAlias = "str | Table | tuple[str | Table, ...] | Picture | Report"


class Reported:
    """A result that shows its report at the prompt and in notebooks."""

    def report(self) -> Report:
        """What the result says."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return repr(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def _text(part: Any, color: bool, width: int | None) -> str:
    if isinstance(part, Report):
        return part.text(color, width)
    if isinstance(part, Table):
        return columns(*part, color, width)
    if isinstance(part, str):
        return wrapped(printable(part), width)
    return "\n".join(_text(entry, color, width) for entry in part)


def _markdown(part: Any, level: int) -> str:
    if isinstance(part, Report):
        return part.markdown(level + 1)
    if isinstance(part, Table):
        return markdown_table(part)
    return (
        printable(part)
        if isinstance(part, str)
        else "\n\n".join(_markdown(entry, level) for entry in part)
    )


def markdown_table(table: Table) -> str:
    """A table as Markdown."""
    header, *body = (f"| {' | '.join(map(_cell, row))} |" for row in (table.header, *table.rows))
    return "\n".join([header, "|" + "---|" * len(table.header), *body])


def _html(part: Part, level: int) -> str:
    if isinstance(part, Report):
        return part.html(level + 1)
    if isinstance(part, Picture):
        return part.html()
    if isinstance(part, Table):
        return html_table(part)
    if isinstance(part, str):
        return "\n".join(map(_paragraph, part.split("\n")))
    return "\n".join(_html(entry, level) for entry in part)


def html_table(table: Table) -> str:
    """A table in a box that a narrow page can scroll, by keyboard too. Classes: `words` for a
    column without numbers, and the tone of a cell."""
    columns = [
        ["words"] if _are_words([row[i] for row in table.rows]) else []
        for i in range(len(table.header))
    ]
    head = "".join(
        f'<th scope="col"{_class(words)}>{_escaped(cell)}</th>'
        for cell, words in zip(table.header, columns, strict=True)
    )
    body = "\n".join(
        f'<tr><th scope="row">{_escaped(row[0])}</th>'
        + "".join(map(_td, row[1:], columns[1:]))
        + "</tr>"
        for row in table.rows
    )
    box = (
        '<div class="table" role="group" tabindex="0" aria-label="table:'
        f' {_escaped(table.header[0])}">'
    )
    return (
        f"{box}<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _are_words(cells: Sequence[Any]) -> bool:
    """Whether fewer than half of the cells that say anything begin as a number does."""
    texts = [text for cell in cells if (text := str(cell)) not in ("", "-")]
    return sum(text[0].isdigit() or text[0] in "+-.±∞" for text in texts) * 2 < len(texts)


def _td(cell: Any, column: list[str]) -> str:
    tone = [cell.tone] if isinstance(cell, Cell) and cell.tone else []
    return f"<td{_class([*column, *tone])}>{_escaped(cell)}</td>"


def _class(names: list[str]) -> str:
    return f' class="{" ".join(names)}"' if names else ""


def _cell(cell: Any) -> str:
    """A cell of Markdown, where no name begins a column, a tag or a link."""
    text = re.sub(r"<(?=[A-Za-z/!])", "&lt;", printable(str(cell), lines=False))
    return text.replace("|", "\\|").replace("](", "]\\(")


def _escaped(text: Any) -> str:
    return html.escape(printable(str(text), lines=False))


def _paragraph(line: str) -> str:
    """A paragraph; what stands in backquotes is set as code."""
    text = re.sub("`([^`]+)`", r"<code>\1</code>", _escaped(line))
    return f"<p>{text}</p>"
