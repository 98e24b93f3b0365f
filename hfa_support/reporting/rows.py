"""Rows of a sheet: named figures in groups, from which text, HTML, PDF, CSV and JSON are made."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from hfa_support.reporting.named import ByName
from hfa_support.reporting.results import Result, storable, without_empty
from hfa_support.reporting.text import (
    TONES,
    WIDTH,
    Table,
    eigenvalue_text,
    printable,
    short_number,
    shown_unit,
    shown_values,
    wrapped,
)

#: Text for a quality below level 3, the last one.
BELOW_LEVEL_3 = "> 3"
#: Longest text that is printed as a value, characters.
_LONGEST = 24
#: Gap between two columns, and least width of the column of notes.
_GAP = "  "
_LEAST_NOTE = 24


@dataclass(frozen=True)
class Row(Result):
    """Figure of a sheet.

    name: name, unique in a sheet
    value: number, complex number or text; angles in rad, or in the unit of the model
    unit: unit of the value, "1" for none
    note: what a reader must know about the value: its status, limits or method
    level: level of flying qualities, 1 to 3, or 4 below them; None for other figures
    digits: number of significant digits that a sheet prints
    least: a smaller magnitude is rounding, and printed as "<= least"
    tone: color of the note, a key of `TONES`, or ""
    rare: whether only a full sheet prints the row
    in_degrees: whether a sheet prints a value in rad or rad/s in degrees, other than a frequency
    """

    name: str
    value: Any
    unit: str = "1"
    note: str = ""
    level: int | None = None
    digits: int = 4
    least: float = 0.0
    tone: str = ""
    rare: bool = False
    in_degrees: bool = True

    def __float__(self) -> float:
        """Return the value, in `unit`."""
        return float(self.value)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {"value": self.value, "unit": self.unit} | without_empty(
            note=self.note or None, level=self.stated_level
        )

    def cells(self) -> tuple[str, str, str, str]:
        """Return name, value, unit and note as text, with angles in degrees.

        A sentence as a value is a note.
        """
        if isinstance(self.value, str) and len(self.value) > _LONGEST and not self.note:
            return self.name, "", "", self.value
        return self.name, self._value_text(), self.printed_unit, self.note

    @property
    def stated_level(self) -> int | str | None:
        """Level of flying qualities, with "> 3" for none of the three."""
        return BELOW_LEVEL_3 if self.level is not None and self.level > 3 else self.level

    @property
    def printed_unit(self) -> str:
        """Return the unit as a sheet prints it, with degrees for angles, or "" for none."""
        unit = shown_unit(self.unit) if self.in_degrees else self.unit
        return "" if unit == "1" else unit

    def _value_text(self) -> str:
        if isinstance(self.value, (str, int)):
            return str(self.value)
        if isinstance(self.value, complex):
            return eigenvalue_text(self.value)
        if 0.0 < abs(self.value) <= self.least:
            return f"<= {self.least:g}"
        return short_number(self.value, self.unit if self.in_degrees else "", self.digits)


class Lacking(NamedTuple):
    """Figure that a sheet does not have, and what is missing for it."""

    name: str
    reason: str


class Group(NamedTuple):
    """Rows of a sheet under one heading, and sentences below them."""

    title: str
    rows: tuple[Row, ...]
    lines: tuple[str, ...] = ()

    def table(self) -> Table:
        """Return the rows as a table. The column of notes is left out if no row has a note."""
        cells = [row.cells() for row in self.rows]
        width = 4 if any(row[3] for row in cells) else 3
        header = (self.title, "value", "unit", "note")
        return Table(header[:width], [row[:width] for row in cells])

    def text(self, color: bool = False, width: int | None = WIDTH) -> str:
        """Return the rows and the sentences as text. Notes are wrapped in a column of their own, or
        stand below their rows where a narrow one has no room for them.
        """
        below = [wrapped(printable(line), width) for line in self.lines]
        return "\n".join([*self._row_lines(color, width), *below])

    def _row_lines(self, color: bool, width: int | None) -> Iterator[str]:
        """Yield the heading, and each row with its note."""
        if not self.rows:
            return
        table = self.table()
        cells = [
            [printable(cell, lines=False) for cell in row[:3]]
            for row in (table.header, *table.rows)
        ]
        of_name, of_value, of_unit = (max(map(len, column)) for column in zip(*cells, strict=True))
        heading, *lines = (
            _GAP.join((name.ljust(of_name), value.rjust(of_value), unit.ljust(of_unit)))
            for name, value, unit in cells
        )
        yield heading.rstrip()
        for row, line in zip(self.rows, lines, strict=True):
            yield from _with_note(line, row, color, width)


def _with_note(line: str, row: Row, color: bool, width: int | None) -> Iterator[str]:
    """Yield the line of a row with its note wrapped beside it, or below it if there is no room."""
    note = printable(row.cells()[3], lines=False)
    begin = len(line) + len(_GAP)
    is_beside = width is None or width - begin >= min(len(note), _LEAST_NOTE)
    indent = begin if is_beside else len(_GAP)
    parts = [note] if width is None else textwrap.wrap(note, width - indent)
    tone = TONES.get(row.tone) if color else None
    below = [f"\033[{tone}m{part}\033[0m" if tone else part for part in parts]
    if is_beside and below:
        first, *below = below
        line += _GAP + first
    yield line.rstrip()
    yield from (" " * indent + part for part in below)


class Sheet(ByName[Row]):
    """Rows of all groups, found by name: sheet["static margin"].value.

    groups: the groups, in reading order
    lacking: name of a missing figure -> what is missing for it
    """

    groups: tuple[Group, ...] = ()

    @classmethod
    def of(
        cls, groups: Iterable[tuple[str, Sequence[Row | Lacking], Sequence[str]]], first: str = ""
    ) -> Sheet:
        """Return the sheet of groups (title, figures, sentences below them).

        A name that two groups have is completed by the title of the later one. Groups without
        anything are left out. The sentences of a group are completed by its missing figures.

        first: title of the group that keeps its names
        """
        given = [*groups]
        taken = {row.name for title, rows, _ in given if title == first for row in rows}
        lacking: dict[str, str] = {}
        completed = []
        for title, figures, lines in given:
            rows = []
            missing: dict[str, list[str]] = {}
            for figure in figures:
                name = figure.name
                if name in taken and title != first:
                    name = f"{name} ({title})"
                if isinstance(figure, Lacking):
                    lacking[name] = figure.reason
                    missing.setdefault(figure.reason, []).append(figure.name)
                    continue
                figure = replace(figure, name=name)
                taken.add(name)
                rows.append(figure)
            not_in_model = [
                f"{', '.join(names)}: not in this model" + f": {reason}" * bool(reason)
                for reason, names in missing.items()
            ]
            if rows or not_in_model or lines:
                completed.append(Group(title, tuple(rows), (*lines, *not_in_model)))
        sheet = cls(row for group in completed for row in group.rows)
        sheet.groups = tuple(completed)
        sheet.lacking = lacking
        return sheet

    def shown(self, full: bool) -> list[Group]:
        """Return the groups that a sheet prints, with rare rows if it is full."""
        groups = []
        for group in self.groups:
            rows = tuple(row for row in group.rows if full or not row.rare)
            if rows or group.lines:
                groups.append(group._replace(rows=rows))
        return groups

    def to_dict(self) -> dict[str, dict[str, Any]]:
        """Return the entries of the file, name -> group, value, unit, and note and level if any."""
        return {
            row.name: {"group": group.title} | storable(row)
            for group in self.groups
            for row in group.rows
        }


def numbers_of(row: Row) -> Iterator[tuple[str, Any]]:
    """Yield name and value of each number or text of a row: parts of a complex number apart."""
    if isinstance(row.value, complex):
        yield f"{row.name} real", row.value.real
        yield f"{row.name} imaginary", row.value.imag
    else:
        yield row.name, row.value


def matrix_of(sheets: Sequence[Sheet]) -> Table:
    """Return the table of many sheets, a row for each, with a column "NAME [UNIT]" for each name.

    Angles are in degrees, as a sheet prints them. A figure without a unit has a column "NAME", and
    a level one of its own, "NAME level". A column that a sheet adds follows its neighbor there.
    """
    columns: list[str] = []
    entries: list[dict[str, Any]] = []
    for sheet in sheets:
        entry: dict[str, Any] = {}
        for row in sheet:
            for name, value in numbers_of(row):
                is_angle = isinstance(value, float) and row.in_degrees
                shown = float(shown_values(value, row.unit)) + 0.0 if is_angle else value  # not -0
                entry[f"{name} [{row.printed_unit}]" if row.printed_unit else name] = shown
            if row.level is not None:
                entry[f"{row.name} level"] = row.stated_level
        entries.append(entry)
        place = 0
        for name in entry:
            if name not in columns:
                columns.insert(place, name)
            place = columns.index(name) + 1
    return Table(
        tuple(columns), [tuple(entry.get(name, "") for name in columns) for entry in entries]
    )
