"""Reports: their checks, documents and files."""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_support.errors import BadInputError, imported, printable, refuse_unknown, shortened
from hfa_support.reporting.parts import Contents, Part, Picture
from hfa_support.reporting.results import Entries, Result, storable
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import (
    WIDTH,
    Cell,
    Table,
    columns,
    matrix_table,
    numbered,
    wrapped,
)

#: Relation between value and limit -> function. A value of nan satisfies none.
RELATIONS: Mapping[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
}


@dataclass(frozen=True)
class Check(Result):
    """A number that must satisfy `value relation limit`.

    name: name of the quantity
    value: the measured number
    limit: the limit
    ok: whether the relation is satisfied
    reason: reason for a failure, or "" if `ok`.
    relation: "<=", "<", ">=", ">" or "=="
    kind: what the check is about: "error", "rest" (an equilibrium), "stability", "game loop",
        "cost", "gain" or ""
    """

    name: str
    value: float
    limit: float
    ok: bool
    reason: str
    relation: str = "<="
    kind: str = ""

    @property
    def sentence(self) -> str:
        """Sentence with the value and its limit, for reports and error messages."""
        return f"{self.name} is {self.value:.3g} and must be {self.relation} {self.limit:.3g}"

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value, without `relation`, which messages alone
        need, and `kind`, which results with checks of several kinds add.
        """
        return {
            "name": self.name,
            "value": self.value,
            "limit": self.limit,
            "ok": self.ok,
            "reason": self.reason,
        }


class Checked:
    """Base class of results that consist of checks. The result passes if all its checks pass."""

    if TYPE_CHECKING:

        @property
        def checks(self) -> tuple[Check, ...]:
            """All checks of this result."""

    @property
    def ok(self) -> bool:
        """True if every check passes."""
        return all(check.ok for check in self.checks)

    def __bool__(self) -> bool:
        return self.ok

    def __getitem__(self, name: str) -> float:
        """Return the measured value of the check with this name.

        Raises BadInputError for an unknown name.
        """
        values = {check.name: check.value for check in self.checks}
        refuse_unknown("unknown check", name, values)
        return values[name]


def checked(
    name: str, value: float, limit: float, reason: str = "", kind: str = "", relation: str = "<="
) -> Check:
    """Return a check that passes if `value relation limit` is true.

    A value of nan fails.

    name: name of the quantity
    value: the measured number
    limit: the limit
    reason: reason for a failure
    kind: as in `Check`
    relation: a key of `RELATIONS`, for example "<="
    """
    ok = RELATIONS[relation](float(value), float(limit))
    return Check(name, float(value), float(limit), ok, "" if ok else reason, relation, kind)


#: Functions that return a check of value <= limit, value >= limit, and value < limit.
at_most = partial(checked, relation="<=")
at_least = partial(checked, relation=">=")
below = partial(checked, relation="<")


def checks_block(checks: Iterable[Check]) -> tuple[Table | str, ...]:
    """Return a table of the checks, followed by a line with the reason for each failed check."""
    listed = tuple(checks)
    rows = [
        (check.name, f"{check.value:.3g}", f"{check.limit:.3g}", verdict_text(check.ok))
        for check in listed
    ]
    reasons = [f"FAIL {check.name}: {check.reason}" for check in listed if not check.ok]
    return Table(("check", "value", "limit", "verdict"), rows), *reasons


def verdict_text(ok: bool) -> str:
    """Return the table cell PASS or FAIL."""
    return Cell("PASS", "good") if ok else Cell("FAIL", "bad")


#: Largest size of matrices and arrays of which `_of_fields` shows the entries, and longest text of
#: a field.
_MOST_ENTRIES = 12
_LONGEST_LINE = 110
#: Suffixes of the files that `Report.save` writes, besides .pdf.
SUFFIXES = (".json", ".npz", ".mat", ".csv", ".md", ".html", ".tex")


@dataclass(frozen=True, eq=False, repr=False)
class Report(Contents):
    """Report of a result, with its contents in reading order."""

    def __repr__(self) -> str:
        return self.text()

    def _repr_html_(self) -> str:
        return self.html(level=3)

    def with_data(self, *results: Result | Mapping[str, Any], **entries: Any) -> Report:
        """Return a copy of the report to whose data results, and entries by name, are added."""
        return replace(self, data=Entries(self.data, *results, entries))

    def with_document(self, document: str) -> Report:
        """Return a copy of the report with number and revision of a document in head and data."""
        head = {"document": document, **self.head}
        return replace(self, head=head).with_data(document=document)

    def text(self, color: bool = False, width: int | None = WIDTH) -> str:
        """Return the report as text without pictures, with a blank line between parts.

        Lines of text are wrapped, and the columns of a table that do not fit are printed below the
        others, as NumPy does.

        color: whether cells with a tone are colored
        width: largest number of characters in a line, or None for lines of unlimited length
        """
        shown = [_text(part, color, width) for part in self.parts if not isinstance(part, Picture)]
        notes = (f"Note: {note}" for note in self.notes)
        title, *after = (
            wrapped(printable(text, lines=True), width)
            for text in (self.title, *notes, self.source)
        )
        return "\n\n".join(filter(None, [title, *shown, *after]))

    def markdown(self, level: int = 1) -> str:
        """Return the report as Markdown without pictures.

        level: level of the heading, increased by one for each nested report
        """
        from hfa_support.reporting.markup import markdown_of

        return markdown_of(self, level)

    def html(self, level: int = 1) -> str:
        """Return the report as an HTML fragment with embedded pictures.

        The fragment has no styles and loads no other file.

        level: level of the heading, increased by one for each nested report
        """
        from hfa_support.reporting.markup import html_of

        return html_of(self, level)

    def page(self) -> str:
        """Return the report as a page in HTML with embedded pictures and styles."""
        from hfa_support.reporting.markup import as_page

        return as_page(self.html())

    def latex(self) -> str:
        """Return the report in LaTeX without pictures. Requires pandas and Jinja2."""
        from hfa_support.reporting.markup import latex_of

        return latex_of(self)

    def json(self) -> str:
        """Return the data of the report as JSON text. Numbers that are not finite become null."""
        from hfa_support.reporting.results import json_text

        return json_text(storable(self.data)).rstrip()

    def save(self, path: str | Path, document: str = "") -> None:
        """Write the report to a file, completely or not at all, with data in full precision.

        path: path of the file
        document: number and revision of the document, shown in the head of sheets and books

        - .json, .npz, .mat: `data`
        - .csv: `records`
        - .html, .md, .pdf: the text, in HTML and PDF with pictures. PDF requires reportlab
        - .tex: the text, its tables with the rules of booktabs. Requires pandas and Jinja2

        A head without a date of issue gets that of the provenance, or today's.

        Raises BadInputError for another suffix.
        """
        from hfa_support.files import write_text
        from hfa_support.reporting.results import save_data

        if document:
            self.with_document(document).save(path)
            return
        if self.head and "issued" not in self.head:
            self._issued().save(path)
            return
        texts = {".html": self.page, ".md": self.markdown, ".tex": self.latex}
        suffix = Path(path).suffix.lower()
        if suffix in texts:
            write_text(path, texts[suffix]())
        elif suffix == ".pdf":
            imported("reportlab", "PDF files require")
            from hfa_support.reporting.pdf import write_pdf

            write_pdf(self, Path(path))
        else:
            save_data(Path(path), storable(self.data), self.records)

    def _issued(self) -> Report:
        """Return the report with the date of its provenance, else today's, in its head."""
        from hfa_support.provenance import now

        date = self.data.get("provenance", {}).get("date", "") or now()
        return replace(self, head={**self.head, "issued": date[:10]})

    def pictures(self) -> Iterator[Picture]:
        """Yield all pictures of this report and of nested reports."""
        for part in self.parts:
            if isinstance(part, Picture):
                yield part
            elif isinstance(part, Report):
                yield from part.pictures()


class Reported:
    """Base class of results that are displayed as reports at the Python prompt and in notebooks."""

    def report(self) -> Report:
        """Return a report of the result: class summary, fields, small matrices and checks."""
        return _of_fields(self)

    def save(self, path: str | Path) -> None:
        """Write the report of the result to a file, as `Report.save` does."""
        self.report().save(path)

    def to_pandas(self) -> Any:
        """Return the records of the report as a `pandas.DataFrame`. Requires pandas.

        Raises BadInputError for a result whose report has no records.
        """
        pandas = imported("pandas", "data frames require")
        records = self.report().records
        if not records.header:
            raise BadInputError(f"{type(self).__name__} has no table of records; read its fields")
        return pandas.DataFrame(list(records.rows), columns=records.header)

    def __repr__(self) -> str:
        return repr(self.report())

    def _repr_html_(self) -> str:
        return self.report()._repr_html_()


def _text(part: Any, color: bool, width: int | None) -> str:
    """Return a part of a report, which may be a tuple of parts, as text (`Report.text`)."""
    if isinstance(part, Report | Group):
        return part.text(color, width)
    if isinstance(part, Table):
        return columns(*part, color=color, width=width)
    if isinstance(part, str):
        return wrapped(printable(part, lines=True), width)
    return "\n".join(_text(entry, color, width) for entry in part)


def _of_fields(result: Any) -> Report:
    """Return a report of a dataclass: its name with the first line of its docstring, the fields
    that are not empty, and small matrices. Fields with repr=False are omitted.
    """
    held = {field.name: getattr(result, field.name) for field in fields(result) if field.repr}
    lines: list[str] = []
    matrices: list[Part] = []
    for name, value in held.items():
        is_matrix = isinstance(value, np.ndarray) and value.ndim == 2 and value.size > 0
        if is_matrix and max(value.shape) <= _MOST_ENTRIES:
            rows, columns = (numbered("", count) for count in value.shape)
            matrices.append(matrix_table(name, rows, columns, value))
        elif (text := _on_one_line(value)) != "-":
            lines.append(f"{name}: {text}")
    kind = type(result)
    first_line = (kind.__doc__ or "").partition("\n")[0]
    title = f"{kind.__name__}: {first_line}"
    return Report(title, ["\n".join(lines), *matrices], data=held)


def _on_one_line(value: Any) -> str:
    """Return a value as one short line of text, or "-" if it is empty. A long array is described by
    its shape, and another result by its type.
    """
    by_name = value._asdict() if hasattr(value, "_asdict") else value
    if value is None:
        text = ""
    elif isinstance(value, np.ndarray) and (value.ndim != 1 or value.size > _MOST_ENTRIES):
        text = f"an array of shape {value.shape}"
    elif isinstance(by_name, Mapping):
        text = ", ".join(f"{name} {_on_one_line(entry)}" for name, entry in by_name.items())
    elif isinstance(value, (tuple, list, np.ndarray)):
        text = ", ".join(map(_on_one_line, value))
    elif isinstance(value, (float, np.floating)):
        text = f"{value:.6g}"
    elif isinstance(value, Reported):
        text = type(value).__name__
    else:
        text = str(value)
    if "array(" in text or " object at 0x" in text:  # a repr that says nothing to a reader
        text = type(value).__name__
    return shortened(" ".join(text.split()) or "-", _LONGEST_LINE)
