"""A report: what a result says, once, as text for a terminal, Markdown, HTML, and data for files."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from hfa_model.support.text import Table, columns

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure that is drawn when somebody looks at it; `text` says what it shows to those who cannot see it."""

    name: str
    text: str
    draw: Callable[[], Figure]


@dataclass(frozen=True, eq=False)
class Block:
    """Parts that belong together: a table and the lines below it, without an empty line between them."""

    parts: Sequence[str | Table]


@dataclass(frozen=True, eq=False)
class Report:
    """What a result says, in the order in which it is read.

    parts: paragraphs (str), tables of formatted cells (Table), blocks, pictures, and reports within the report.
    data: the result for JSON, .npz and .mat. records: for CSV, numbers with all digits. notes: what to know before
    trusting it.
    """

    title: str
    parts: Sequence[str | Table | Block | Picture | Report] = ()
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    records: Table | None = None

    def text(self) -> str:
        """For a terminal: parts with an empty line between them; pictures have no place there."""
        shown = [_text(part) for part in self.parts if not isinstance(part, Picture)]
        return "\n\n".join([*filter(None, [self.title]), *shown, *(f"Note: {note}" for note in self.notes)])

    def markdown(self, level: int = 1) -> str:
        """With headings from `level` on; pictures as links to files of their name."""
        shown = [_markdown(part, level) for part in self.parts]
        heading = [f"{'#' * level} {_one_line(self.title)}"] if self.title else []
        return "\n\n".join([*heading, *shown, *(f"Note: {note}" for note in self.notes)])

    def html(self, level: int = 1) -> str:
        """A fragment without styles, every word escaped; pictures embedded, nothing loaded from elsewhere."""
        heading = [f"<h{level}>{html.escape(_one_line(self.title))}</h{level}>"] if self.title else []
        shown = [_html(part, level) for part in self.parts]
        return "\n".join([*heading, *shown, *(f"<p>Note: {html.escape(note)}</p>" for note in self.notes)])


class Reported:
    """A result that shows its report at the prompt and in notebooks."""

    def report(self) -> Report:
        """What the result says."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self.report().text()

    def _repr_html_(self) -> str:
        return self.report().html(level=3)


def _text(part: str | Table | Block | Picture | Report) -> str:
    if isinstance(part, Report):
        return part.text()
    if isinstance(part, Block):
        return "\n".join(map(_text, part.parts))
    return columns(part.header, part.rows) if isinstance(part, Table) else str(part)


def _markdown(part: str | Table | Block | Picture | Report, level: int) -> str:
    if isinstance(part, Report):
        return part.markdown(level + 1)
    if isinstance(part, Block):
        return "\n\n".join(_markdown(each, level) for each in part.parts)
    if isinstance(part, Picture):
        return f"![{part.text}]({part.name})"
    if isinstance(part, Table):
        rule = ("---", *("---:" for _ in part.header[1:]))
        return "\n".join(f"| {' | '.join(_cell(cell) for cell in row)} |" for row in (part.header, rule, *part.rows))
    return part


def _html(part: str | Table | Block | Picture | Report, level: int) -> str:
    if isinstance(part, Report):
        return part.html(level + 1)
    if isinstance(part, Block):
        return "\n".join(_html(each, level) for each in part.parts)
    if isinstance(part, Picture):
        from hfa_model.support.figure import png_bytes

        data = base64.b64encode(png_bytes(part.draw())).decode("ascii")
        return f'<p><img alt="{html.escape(part.text)}" src="data:image/png;base64,{data}"></p>'
    if isinstance(part, Table):
        head = "".join(f'<th scope="col">{html.escape(str(cell))}</th>' for cell in part.header)
        body = "".join(
            f'<tr><th scope="row">{html.escape(str(row[0]))}</th>'
            + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row[1:])
            + "</tr>"
            for row in part.rows
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return "".join(f"<p>{html.escape(line)}</p>" for line in part.split("\n"))


def _cell(cell: Any) -> str:
    return str(cell).replace("|", "\\|")


def _one_line(title: str) -> str:
    return " ".join(title.split())
