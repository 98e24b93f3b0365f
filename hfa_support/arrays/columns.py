"""Columns of a table: their names and units, and whose columns they are."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_support.arrays.text import rows_of_text
from hfa_support.errors import BadInputError, numbers_in, prefix_errors, shortened, shown
from hfa_support.units import conversion_factor, si_unit, stated_factor

#: Last column of a file of this program: its provenance, in the first row alone.
_PROVENANCE = "about"


class Label(NamedTuple):
    """Name of a row or a column, and its unit or ""."""

    name: str
    unit: str

    @classmethod
    def of(cls, text: str) -> Label:
        """Return the label of a text such as "speed [ft/s]", "speed (ft/s)" or "cg [%MAC]".

        A number in round brackets, without a blank before it, is an index: "x(1)".
        """
        bracket = r"\s*\[(.*)\]|(?:\s+|(?!\(\d+\)))\(((?:[^()]|\([^()]*\))*)\)"
        parts = re.fullmatch(rf"(.*?)(?:{bracket})?", text.strip(), re.DOTALL)
        assert parts is not None  # any text matches
        unit = (parts[2] or parts[3] or "").strip()
        return cls(parts[1], "%" if re.fullmatch(r"%\s*(MAC|mac|c|chord)", unit) else unit)


class Column(NamedTuple):
    """Column of a table.

    where: the table, for messages
    name: of its heading
    unit: of its heading, "" if it has none. None without one in a dictionary of Python, whose
        numbers are in the unit of the model, with angles in radians
    cells: texts of a file, or numbers
    rows: number of the row of each cell, for messages
    head: number of the row of headings in a file of text, or 0
    """

    where: str
    name: str
    unit: str | None
    cells: Sequence[Any] | np.ndarray
    rows: Sequence[int]
    head: int = 0

    @property
    def heading(self) -> str:
        """The table and the row of the headings, for messages."""
        return f"{self.where}: row {self.head}" if self.head else self.where

    def numbers(self, unit: str = "") -> np.ndarray:
        """Return the cells as numbers (N,) in a unit; nan for an empty cell.

        unit: the unit, or "" if it is unknown: the numbers are in that of the heading, if any

        Raises BadInputError for a text, and as `factor`.
        """
        factor = self.factor(unit)
        if isinstance(self.cells, np.ndarray):
            with prefix_errors(self.where):
                return factor * np.asarray(numbers_in(self.name, self.cells), dtype=float)
        return factor * np.array([*map(self._number, self.cells, self.rows)], dtype=float)

    def factor(self, unit: str) -> float:
        """Return the factor from the cells to a unit, 1 to an unknown one, "".

        Raises BadInputError for a heading whose unit cannot be converted, and for an angle without
        a unit, which could be in degrees or radians.
        """
        if unit.startswith("rad") and self.unit == "":
            degrees = unit.replace("rad", "deg", 1)
            raise BadInputError(
                f"{self.heading}: {self.name} has no unit; write {self.name} [{degrees}] or "
                f"{self.name} [{unit}]"
            )
        factor = stated_factor(self.unit, unit) if self.unit and unit else 1.0
        if factor is None:
            known = " or ".join(dict.fromkeys((unit, si_unit(unit))))
            raise BadInputError(
                f"{self.heading}: {self.name} is in {shortened(str(self.unit))}; give it in {known}"
            )
        return factor

    def refuse(self, is_wrong: np.ndarray, fault: str) -> None:
        """Raise BadInputError for the first cell that is wrong.

        is_wrong: (N,)
        fault: words that follow the name of the column
        """
        for place in np.flatnonzero(is_wrong).tolist():
            raise BadInputError(f"{self.where}, row {self.rows[place]}: {self.name} {fault}")

    def _number(self, cell: str, row: int) -> float:
        """Return the number in a cell, nan for an empty one."""
        try:
            return float(cell) if cell else math.nan
        except ValueError:
            raise BadInputError(
                f"{self.where}, row {row}: {self.name} is {shown(cell)}; give a number, with a "
                "decimal point, or leave the cell empty"
            ) from None


def columns_of_text(where: str, content: bytes, *, has_headings: bool = True) -> list[Column]:
    """Return the columns of a table as text, whose first row has the headings.

    has_headings: False for a table that may have none: a row with a number is none
    """
    rows = rows_of_text(where, content)
    first, titles = rows[0]
    head = first if has_headings or not any(map(is_number, titles)) else 0
    if head:
        del rows[0]
    for number, row in rows:
        if len(row) < len(titles) or any(row[len(titles) :]):
            raise BadInputError(
                f"{where}: row {number} has {len(row)} cells, but row {first} has {len(titles)}; "
                "correct the row; if decimals have commas, separate the cells by ;"
            )
    columns = []
    for place, title in enumerate(titles):
        cells = [row[place] for _, row in rows]
        is_count = not (title or place) and cells == [*map(str, range(len(cells)))]  # of pandas
        if head and (is_count or title == _PROVENANCE or not (title or any(cells))):
            continue
        label = Label.of(title) if head else Label(f"column {place + 1}", "")
        columns.append(Column(where, *label, cells, [number for number, _ in rows], head))
    return columns


def is_number(cell: str) -> bool:
    """Return whether a cell is a number, which may be inf or nan."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def plain_name(typed: str) -> str:
    """Return a name in small letters without points and blanks: "C.G." is cg."""
    return re.sub(r"\W+", "_", typed.replace(".", "")).lower()


#: Other names of the time.
_TIMES = ("t", "timestamp", "seconds")


def matched(columns: Iterable[Column], known: Mapping[str, str]) -> dict[str, Column]:
    """Return the columns in their order, by the names that are known, and the others by their own.

    A name is matched by its letters, else by its `plain_name`.

    known: name -> unit, or "" for any

    Raises BadInputError for a column without a name, for two of one name, and for a unit in a name:
    "time_ms".
    """
    found: dict[str, Column] = {}
    for column in columns:
        if not column.name:
            raise BadInputError(f"{column.heading} has a column without a name; name or remove it")
        plain = plain_name(column.name)
        plain = "time" if plain in _TIMES else plain
        name = plain if plain in known and column.name not in known else column.name
        signal, _, unit = column.name.rpartition("_")
        if name not in known and conversion_factor(unit, known.get(signal.lower()) or "?"):
            raise BadInputError(
                f'{column.heading}: unknown column {shown(name)}; write "{signal.lower()} [{unit}]"'
            )
        if name in found:
            raise BadInputError(f"{column.heading} has {name} twice; rename or remove one column")
        found[name] = column
    return found
