"""Tables of reports in LaTeX, with the rules of the package booktabs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from hfa_support.errors import imported
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Table, printable


def latex_tables(title: str, parts: Any) -> str:
    r"""Return the tables of a report as LaTeX, each a `tabular` that \input places in a document.

    Text outside the tables is omitted. Requires pandas and Jinja2.

    title: first lines of the file, as comments
    parts: parts of the report
    """
    comments = "\n".join(f"% {line}" for line in printable(title).split("\n"))
    return "\n".join([comments, *map(_tabular, _tables(parts))])


def _tables(part: Any) -> Iterator[Table]:
    """Yield the tables of a part, and of the parts in it, in reading order."""
    if isinstance(part, Group):
        yield part.table()
    elif isinstance(part, Table):
        yield part
    elif isinstance(part, (tuple, list)):
        for each in part:
            yield from _tables(each)
    elif hasattr(part, "parts"):
        yield from _tables(tuple(part.parts))


def _tabular(table: Table) -> str:
    imported("jinja2", "LaTeX files require")
    pandas = imported("pandas", "LaTeX files require")
    cells = [[str(cell) for cell in row] for row in table.rows]
    style = pandas.DataFrame(cells, columns=list(table.header)).style.hide(axis="index")
    style = style.format(escape="latex").format_index(escape="latex", axis=1)
    alignment = "l" + "r" * (len(table.header) - 1)
    return str(style.to_latex(hrules=True, column_format=alignment))
