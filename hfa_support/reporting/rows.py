"""Rows of a report, and values by their names."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from hfa_support.errors import BadInputError, imported, printable, refuse_unknown
from hfa_support.reporting.results import Result, storable, without_empty
from hfa_support.reporting.text import (
    TONES,
    WIDTH,
    Table,
    eigenvalue_text,
    short_number,
    shown_unit,
    shown_values,
    wrapped,
)

if TYPE_CHECKING:
    import pandas


class NamedArray(np.ndarray):
    """Array with names for the entries of each axis.

    names: for each axis, the names of its entries, or () for an axis without names

    Names index the last axes. For example, states["alpha"] of states (N, n) has the shape (N,), and
    A["pitch_rate", "alpha"] is a number.
    """

    names: tuple[tuple[str, ...], ...] = ()

    def __getitem__(self, index: Any) -> Any:
        """Return entries by name, or by any index of a NumPy array.

        Raises BadInputError for an unknown name.
        """
        values = np.asarray(self)
        keys = index if isinstance(index, tuple) else (index,)
        if str not in map(type, keys):
            return values[index]
        numbers = []  # a name becomes the number of its entry
        names_of_axes = ((),) * len(keys) + self.names  # a computed array has no names
        for key, names in zip(keys, names_of_axes[-len(keys) :], strict=True):
            if isinstance(key, str):
                refuse_unknown("unknown name", key, names)
                key = names.index(key)
            numbers.append(key)
        return values[..., *numbers][()]  # converts an array without axes to a number

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        """Return a computed array, or a number instead of an array without axes."""
        return array[()] if array.ndim == 0 else super().__array_wrap__(array, context)

    def __repr__(self) -> str:
        return repr(np.asarray(self))

    def __reduce__(self) -> Any:
        return with_names, (np.asarray(self), *self.names)

    def __copy__(self) -> NamedArray:
        return with_names(np.array(self), *self.names)

    def __deepcopy__(self, _: Any) -> NamedArray:
        return self.__copy__()


def with_names(values: np.ndarray, *names: tuple[str, ...]) -> NamedArray:
    """Return a view of an array, with names for the entries of each axis.

    names: a tuple for each axis, () for an axis without names
    """
    named = values.view(NamedArray)
    named.names = names
    return named


Named = TypeVar("Named", covariant=True)


class ByName(tuple[Named, ...]):
    """Tuple whose entries are found by number or by their `name`, as in modes["phugoid"].

    lacking: name of a missing entry -> why it is missing
    """

    lacking: Mapping[str, str] = MappingProxyType({})

    def __getitem__(self, index: Any) -> Any:
        """Return the entry with this number or name. Raises BadInputError for an unknown name."""
        if not isinstance(index, str):
            return super().__getitem__(index)
        if index in self.lacking:
            raise BadInputError(f"there is no {index}: {self.lacking[index]}")
        refuse_unknown("unknown name", index, self.keys())
        return self[self.keys().index(index)]

    def keys(self) -> list[str]:
        """Return the names of the entries.

        Because of this method, dict(modes) is a dictionary from names to entries.
        """
        return [entry.name for entry in self]  # type: ignore[attr-defined]  # entries have names

    def values(self) -> Any:
        """Return the entries, which are this tuple, as `dict.values` does."""
        return self

    def items(self) -> Any:
        """Return the pairs (name, entry), as `dict.items` does."""
        return dict(self).items()

    def to_pandas(self) -> pandas.DataFrame:
        """Return a `pandas.DataFrame` with one row for each entry, indexed by its name."""
        pandas = imported("pandas", "data frames require")
        rows = []
        for entry in self:
            fields = entry._asdict() if hasattr(entry, "_asdict") else vars(entry)
            rows.append(  # a dictionary, as the participations of a mode, is no cell
                {key: field for key, field in fields.items() if not isinstance(field, dict)}
            )
        return pandas.DataFrame(rows).set_index("name")

    def _repr_html_(self) -> str | None:
        """Return a table for notebooks, or None without entries or without pandas."""
        if not self or find_spec("pandas") is None:
            return None
        return str(self.to_pandas().to_html())


#: Text for a quality below level 3, the last one.
BELOW_LEVEL_3 = "below 3"
#: Longest text that is printed as a value, characters.
_LONGEST_VALUE = 24
#: Gap between two columns, and least width of the column of notes.
_GAP = "  "
_LEAST_NOTE_WIDTH = 24


class RowText(NamedTuple):
    """Row of a sheet as it is printed, with angles in degrees and without the unit 1."""

    name: str
    value: str
    unit: str
    note: str


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

    def cells(self) -> RowText:
        """Return the row as it is printed; a sentence as a value is printed as its note."""
        value = self.value
        if isinstance(value, str) and len(value) > _LONGEST_VALUE and not self.note:
            return RowText(self.name, "", "", value)
        if isinstance(value, (str, int)):
            text = str(value)
        elif isinstance(value, complex):
            text = eigenvalue_text(value)
        elif 0.0 < abs(value) <= self.least:
            text = f"<= {self.least:g}"
        else:
            text = short_number(value, self.unit if self.in_degrees else "", self.digits)
        unit = shown_unit(self.unit) if self.in_degrees else self.unit
        return RowText(self.name, text, "" if unit == "1" else unit, self.note)

    @property
    def stated_level(self) -> int | str | None:
        """Level of flying qualities, "below 3" for none of the three."""
        return None if self.level is None else stated_level(self.level)


def stated_level(level: int) -> int | str:
    """Return a level of flying qualities, "below 3" for none of the three."""
    return BELOW_LEVEL_3 if level > 3 else level


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
        width = 4 if any(row.note for row in cells) else 3
        header = (self.title, "value", "unit", "note")
        return Table(header[:width], [row[:width] for row in cells])

    def text(self, color: bool = False, width: int | None = WIDTH) -> str:
        """Return the rows and the sentences as text. Notes are wrapped in a column of their own, or
        stand below their rows if the width leaves no room for the column.
        """
        lines: list[str] = []
        if self.rows:
            header = (self.title, "value", "unit", "")
            cells = [header, *(row.cells() for row in self.rows)]
            texts = [[printable(cell) for cell in row] for row in cells]
            of_name, of_value, of_unit, _ = (  # widths of the columns
                max(map(len, column)) for column in zip(*texts, strict=True)
            )
            tones = ("", *(row.tone if color else "" for row in self.rows))
            for (name, value, unit, note), tone in zip(texts, tones, strict=True):
                line = _GAP.join((name.ljust(of_name), value.rjust(of_value), unit.ljust(of_unit)))
                lines += _with_note(line, note, TONES.get(tone, ""), width)
        lines += [wrapped(printable(line, lines=True), width) for line in self.lines]
        return "\n".join(lines)


def _with_note(line: str, note: str, color: str, width: int | None) -> Iterator[str]:
    """Yield the line of a row with its note wrapped beside it, or below it if there is no room.

    color: code of the color of the note on a terminal, or ""
    """
    begin = len(line) + len(_GAP)
    is_beside = width is None or width - begin >= min(len(note), _LEAST_NOTE_WIDTH)
    indent = begin if is_beside else len(_GAP)
    note_lines = [note] if width is None else textwrap.wrap(note, width - indent)
    if color:
        note_lines = [f"\033[{color}m{note_line}\033[0m" for note_line in note_lines]
    if is_beside and note_lines:
        first, *note_lines = note_lines
        line += _GAP + first
    yield line.rstrip()
    yield from (" " * indent + note_line for note_line in note_lines)


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

        first: title of the group whose names are not completed, wherever it is in the order
        """
        given = [*groups]
        taken_names = {figure.name for title, rows, _ in given if title == first for figure in rows}
        lacking: dict[str, str] = {}
        completed = []
        for title, figures, lines in given:
            rows = []
            names_lacking: dict[str, list[str]] = {}  # reason -> names
            for figure in figures:
                name = figure.name
                if name in taken_names and title != first:
                    name = f"{name} ({title})"
                if isinstance(figure, Lacking):
                    lacking[name] = figure.reason
                    names_lacking.setdefault(figure.reason, []).append(figure.name)
                else:
                    taken_names.add(name)
                    rows.append(replace(figure, name=name))

            not_in_model = [
                ": ".join(filter(None, (", ".join(names), "not in this model", reason)))
                for reason, names in names_lacking.items()
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
    """Yield name and value of a row. A complex value has two names and values, of its real and its
    imaginary part.
    """
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
    headings: list[str] = []
    cells_of_sheets = [_cells_by_heading(sheet) for sheet in sheets]
    for cells in cells_of_sheets:
        place = 0
        for heading in cells:
            if heading not in headings:
                headings.insert(place, heading)
            place = headings.index(heading) + 1
    rows = [tuple(cells.get(heading, "") for heading in headings) for cells in cells_of_sheets]
    return Table(tuple(headings), rows)


def _cells_by_heading(sheet: Sheet) -> dict[str, Any]:
    """Return heading -> cell of the line of a sheet in `matrix_of`."""
    cells: dict[str, Any] = {}
    for row in sheet:
        unit = row.cells().unit
        for name, value in numbers_of(row):
            if isinstance(value, float) and row.in_degrees:
                value = float(shown_values(value, row.unit)) + 0.0  # 0 in place of -0
            cells[f"{name} [{unit}]" if unit else name] = value
        if row.level is not None:
            cells[f"{row.name} level"] = row.stated_level
    return cells
