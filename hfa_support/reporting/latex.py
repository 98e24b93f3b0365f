"""Tables of reports in LaTeX, with the rules of the package booktabs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hfa_support.errors import imported
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, printable

#: Character with a meaning in LaTeX -> how it is printed.
_ESCAPED = {each: f"\\{each}" for each in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def latex_tables(title: str, parts: Any) -> str:
    r"""Return the tables of a report as LaTeX, each a `tabular` that \input places in a document.

    The first lines of reports in it and the sentences below tables are paragraphs. Other text is
    omitted. Requires pandas and Jinja2.

    title: first lines of the file, as comments
    parts: parts of the report
    """
    comments = "\n".join(f"% {line}" for line in printable(title).split("\n"))
    return "\n".join([comments, *_blocks(parts)])


def _blocks(part: Any) -> Iterator[str]:
    """Yield tables and paragraphs of a part, and of the parts in it, in reading order."""
    if isinstance(part, Group):
        yield _tabular(part.table())
        yield from map(_paragraph, part.lines)
    elif isinstance(part, Table):
        yield _tabular(part)
    elif isinstance(part, (tuple, list)):
        for each in part:
            yield from _blocks(each)
    elif hasattr(part, "parts"):
        yield from map(_paragraph, part.title.split("\n"))
        yield from _blocks(tuple(part.parts))


def _paragraph(text: str) -> str:
    """Return a sentence as a paragraph."""
    escaped = "".join(_ESCAPED.get(each, each) for each in printable(text, lines=False))
    return f"\\noindent {escaped}\n"


def _tabular(table: Table) -> str:
    imported("jinja2", "LaTeX files require")
    pandas = imported("pandas", "LaTeX files require")
    cells = [[str(cell) for cell in row] for row in table.rows]
    style = pandas.DataFrame(cells, columns=list(table.header)).style.hide(axis="index")
    style = style.format(escape="latex").format_index(escape="latex", axis=1)
    alignment = "l" + "r" * (len(table.header) - 1)
    return str(style.to_latex(hrules=True, column_format=alignment))
