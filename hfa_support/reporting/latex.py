"""Reports in LaTeX, tables with the rules of the package booktabs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hfa_support.errors import imported, printable
from hfa_support.reporting.parts import Contents
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, are_words, flowing

#: Character with a meaning in LaTeX -> how it is printed.
_ESCAPED = {each: f"\\{each}" for each in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def latex_of(report: Contents) -> str:
    r"""Return a report as LaTeX that \input places in a document: its lines and notes are
    paragraphs, its tables `tabular`. Requires pandas and Jinja2.
    """
    first = printable(report.title)
    return "\n".join([f"% {first}", *_blocks(report)])


def _blocks(part: Any) -> Iterator[str]:
    """Yield tables and paragraphs of a part, and of the parts in it, in reading order."""
    if isinstance(part, Group):
        if part.rows:
            yield _tabular(part.table())
        yield from map(_paragraph, part.lines)
    elif isinstance(part, Table):
        yield _tabular(part)
    elif isinstance(part, str):
        yield from map(_paragraph, filter(None, flowing(part).split("\n")))
    elif isinstance(part, (tuple, list)):
        for each in part:
            yield from _blocks(each)
    elif isinstance(part, Contents):
        yield from _blocks(part.title)
        yield from (_paragraph(f"{label}: {text}") for label, text in part.head.items())
        yield from _blocks(tuple(part.parts))
        yield from (_paragraph(f"Note: {note}") for note in part.notes)
        yield from _blocks(part.source)


def _paragraph(text: str) -> str:
    """Return a sentence as a paragraph."""
    escaped = "".join(_ESCAPED.get(each, each) for each in printable(text))
    return f"\\noindent {escaped}\n"


def _tabular(table: Table) -> str:
    """Return a table, with columns of words aligned left and others right."""
    imported("jinja2", "LaTeX files require")
    pandas = imported("pandas", "LaTeX files require")
    cells = [[str(cell) for cell in row] for row in table.rows]
    style = pandas.DataFrame(cells, columns=list(table.header)).style.hide(axis="index")
    style = style.format(escape="latex").format_index(escape="latex", axis=1)
    columns = zip(*cells, strict=True) if cells else ((),) * len(table.header)
    alignment = "".join(
        "l" if index == 0 or are_words(column) else "r" for index, column in enumerate(columns)
    )
    return str(style.to_latex(hrules=True, column_format=alignment))
