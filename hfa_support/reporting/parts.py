"""Contents of a report: its parts, which documents of each format are made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

from hfa_support.reporting.rows import Group, Sheet
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Who signs a book, and what is left blank for a signature.
SIGNERS = ("author", "checked", "approved")
BLANKS = ("name", "date", "signature")


@dataclass(frozen=True, eq=False)
class Picture:
    """Figure in a report, drawn when the report is shown.

    name: name of the picture
    text: description of the picture, for readers who cannot see it
    draw: function that draws the figure
    """

    name: str
    text: str
    draw: Callable[[], Figure]

    @cached_property
    def figure(self) -> Figure:
        """The figure, drawn at the first access."""
        return self.draw()

    @cached_property
    def png(self) -> bytes:
        """Content of a PNG file of the figure."""
        from hfa_support.reporting.figure import png_bytes

        return png_bytes(self.figure)


#: Records of a report without records.
NO_RECORDS = Table((), ())


Part: TypeAlias = "str | Table | Group | tuple[str | Table, ...] | Picture | Contents"


@dataclass(frozen=True, eq=False, repr=False)
class Contents:
    """What a report contains, in reading order.

    title: heading, and further lines that are printed below the heading
    parts: paragraphs (str), tables of formatted cells (Table), rows of a sheet (Group), pictures,
      nested reports, and tuples of paragraphs and tables that are printed without a blank line
      between them
    notes: notes on the result
    data: entries of the result by name, for JSON, .npz and .mat
    records: the result for CSV, with numbers in full precision
    source: the provenance, shown last
    head: label -> text of a sheet or of a book of sheets, shown in HTML and PDF with lines to sign
    anchor: key by which cells of tables link to the report, or ""
    failure: reason why the command fails after it has shown this report, or ""
    sheet: all rows of a sheet, found by name, also those that `parts` leave out
    """

    title: str
    parts: Sequence[Part] = ()
    notes: Sequence[str] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    records: Table = NO_RECORDS
    source: str = ""
    failure: str = ""
    head: Mapping[str, str] = field(default_factory=dict)
    anchor: str = ""
    sheet: Sheet = field(default_factory=Sheet)

    @property
    def is_book(self) -> bool:
        """Whether the report contains the reports of several trims behind a cover."""
        return bool(self.head) and any(isinstance(part, Contents) for part in self.parts)
