"""A report: what a result says, once, as text for a terminal, Markdown, HTML, LaTeX, and data for files."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from hfa_support.reporting.text import PLAIN, Style, Table, Toned, columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure


NO_RECORDS = Table((), ())
_SECTIONS = ("section", "subsection", "subsubsection", "paragraph")


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure that is drawn when somebody looks at it; `text` says what it shows to those who cannot see it."""

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
        text = html.escape(self.text)
        image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
        return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


@dataclass(frozen=True, eq=False)
class Block:
    """Parts that belong together: a table and the lines below it, without an empty line between them."""

    parts: Sequence[str | Table]


@dataclass(frozen=True, eq=False, repr=False)
class Report:
    """What a result says, in the order in which it is read.

    title: a heading, and below it what follows its first line. parts: paragraphs (str), tables of formatted cells
    (Table), blocks, pictures, and reports within the report. data: the result for JSON, .npz and .mat. records: for
    CSV, numbers with all digits. notes: what to know before trusting it. source: where it comes from, said last.
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

    def text(self, style: Style = PLAIN) -> str:
        """For a terminal: parts with an empty line between them; pictures have no place there."""
        shown = [_text(part, style) for part in self.parts if not isinstance(part, Picture)]
        notes = (f"Note: {note}" for note in self.notes)
        return "\n\n".join(filter(None, [self.title, *shown, *notes, self.source]))

    def markdown(self, level: int = 1) -> str:
        """With headings from `level` on; pictures as links to files of their name."""
        shown = [_markdown(part, level) for part in self.parts]
        first, *others = self.title.split("\n")
        heading = [f"{'#' * level} {first}"] if first else []
        notes = (f"Note: {note}" for note in self.notes)
        return "\n\n".join(filter(None, [*heading, *others, *shown, *notes, self.source]))

    def html(self, level: int = 1) -> str:
        """A fragment without styles, every word escaped; pictures embedded, nothing loaded from elsewhere."""
        first, *others = self.title.split("\n")
        heading = [f"<h{level}>{html.escape(first)}</h{level}>"] if first else []
        shown = [_html(part, level) for part in self.parts]
        said = (*(f"Note: {note}" for note in self.notes), *filter(None, self.source.split("\n")))
        return "\n".join([*heading, *map(_paragraph, others), *shown, *map(_paragraph, said)])

    def latex(self, level: int = 1) -> str:
        """A fragment, sections from `level` on, every word escaped; pictures by their names (graphicx)."""
        from hfa_support.reporting.latex import latex_text

        shown = [_latex(part, level) for part in self.parts]
        first, *others = self.title.split("\n")
        heading = [f"\\{_SECTIONS[min(level, 4) - 1]}*{{{latex_text(first)}}}"] if first else []
        said = (*(f"Note: {note}" for note in self.notes), *filter(None, self.source.split("\n")))
        return "\n\n".join([*heading, *map(latex_text, others), *shown, *map(latex_text, said)])

    def json(self) -> str:
        """The data; a number that is not finite becomes null."""
        from hfa_support.jsonable import json_text

        return json_text(self.data)

    def save(self, path: Path) -> None:
        """Data (.json, .npz, .mat) or records (.csv) as one file, whole or not at all, numbers with all digits."""
        from hfa_support.reporting.data_files import save_data

        save_data(path, self.data, self.records)

    def without_pictures(self) -> Report:
        """The same report where no picture can be put beside it."""
        kept = [part for part in self.parts if not isinstance(part, Picture)]
        return replace(self, parts=[each.without_pictures() if isinstance(each, Report) else each for each in kept])

    def pictures(self) -> Iterator[Picture]:
        """All pictures, those of the reports within it too."""
        for part in self.parts:
            if isinstance(part, Picture):
                yield part
            elif isinstance(part, Report):
                yield from part.pictures()


Part: TypeAlias = str | Table | Block | Picture | Report


class Reported:
    """A result that shows its report at the prompt and in notebooks."""

    def report(self) -> Report:
        """What the result says."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return repr(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def _text(part: str | Table | Block | Report, style: Style) -> str:
    if isinstance(part, Report):
        return part.text(style)
    if isinstance(part, Block):
        return "\n".join(_text(each, style) for each in part.parts)
    return columns(*part, style) if isinstance(part, Table) else part


def _markdown(part: Part, level: int) -> str:
    if isinstance(part, Report):
        return part.markdown(level + 1)
    if isinstance(part, Block):
        return "\n\n".join(_markdown(each, level) for each in part.parts)
    if isinstance(part, Picture):
        return f"![{part.text}]({part.name})"
    return markdown_table(part) if isinstance(part, Table) else part


def markdown_table(table: Table) -> str:
    """A table as Markdown."""
    header, *body = (f"| {' | '.join(map(_cell, row))} |" for row in (table.header, *table.rows))
    return "\n".join([header, "|" + "---|" * len(table.header), *body])


def _html(part: Part, level: int) -> str:
    if isinstance(part, Report):
        return part.html(level + 1)
    if isinstance(part, Block):
        return "\n".join(_html(each, level) for each in part.parts)
    if isinstance(part, Picture):
        return part.html()
    if isinstance(part, Table):
        return html_table(part)
    return "\n".join(f"<p>{html.escape(line)}</p>" for line in part.split("\n"))


def html_table(table: Table) -> str:
    """A table in a box that a narrow page can scroll, by keyboard too. Classes: `words` for a column without numbers,
    and the tone of a cell."""
    columns = [["words"] if _are_words([row[i] for row in table.rows]) else [] for i in range(len(table.header))]
    head = "".join(
        f'<th scope="col"{_class(words)}>{html.escape(str(cell))}</th>'
        for cell, words in zip(table.header, columns, strict=True)
    )
    body = "\n".join(
        f'<tr><th scope="row">{html.escape(str(row[0]))}</th>' + "".join(map(_td, row[1:], columns[1:])) + "</tr>"
        for row in table.rows
    )
    box = f'<div class="table" role="group" tabindex="0" aria-label="table: {html.escape(str(table.header[0]))}">'
    return f"{box}<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>"


def _are_words(cells: Sequence[Any]) -> bool:
    """Whether fewer than half of the cells that say anything begin as a number does."""
    said = [text for cell in cells if (text := str(cell)) not in ("", "-")]
    return sum(text[0].isdigit() or text[0] in "+-.±∞" for text in said) * 2 < len(said)


def _td(cell: Any, column: list[str]) -> str:
    return f"<td{_class([*column, *([cell.tone] if isinstance(cell, Toned) else [])])}>{html.escape(str(cell))}</td>"


def _class(names: list[str]) -> str:
    return f' class="{" ".join(names)}"' if names else ""


def _latex(part: Part, level: int) -> str:
    from hfa_support.reporting.latex import latex_table, latex_text

    if isinstance(part, Report):
        return part.latex(level + 1)
    if isinstance(part, Block):
        return "\n\n".join(_latex(each, level) for each in part.parts)
    if isinstance(part, Picture):
        return f"\\includegraphics[width=\\linewidth]{{{part.name}}}"
    return latex_table(part) if isinstance(part, Table) else "\n\n".join(map(latex_text, part.split("\n")))


def _cell(cell: Any) -> str:
    return str(cell).replace("|", "\\|")


def _paragraph(line: str) -> str:
    return f"<p>{html.escape(line)}</p>"
