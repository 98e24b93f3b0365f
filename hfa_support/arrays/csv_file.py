"""Matrices from .csv files: one matrix per file, with optional names and units."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.errors import file_faults, shortened
from hfa_support.files import regular_file

#: Matrix -> sides that belong to the states: 0 for its rows, 1 for its columns.
_STATES = {"A": (0, 1), "B": (0,), "E": (0,), "Q": (0, 1), "P": (0, 1), "K": (1,)}


def matrices_and_names(files: Mapping[str, Path]) -> dict[str, Any]:
    """Return the matrices of .csv files, and the names and units of states and inputs, by name.

    The names are stored as "states" and "inputs", the units as "state_units" and "input_units".
    Names and units that the files do not contain are omitted.

    files: name of the matrix -> file

    Raises ValueError for a faulty file.
    """
    tables = {}
    for name, file in files.items():
        with file_faults(file):
            tables[name] = _table(name, file)
    return _names_and_units(tables) | {name: table.matrix for name, table in tables.items()}


#: First columns of the table of P and K that `hfa solve` and `hfa learn` write.
_OF_ENTRIES = ["matrix", "row", "column", "value", "unit"]
#: Unit of an entry of K: unit of the input, unit of the state.
_UNIT_OF_GAIN = re.compile(r"\((.*)\)/\((.*)\)")


def matrices_of_entries(path: Path) -> dict[str, Any] | None:
    """Return the matrices of a table with a row for each entry, or None for another file.

    The names and units of states and inputs are those of K.

    Raises ValueError for a faulty file.
    """
    with regular_file(path).open(encoding="utf-8-sig", newline="") as stream:
        header, *rows = [*csv.reader(stream)] or [[]]
    if header[: len(_OF_ENTRIES)] != _OF_ENTRIES:
        return None
    stored: dict[str, Any] = {}
    for matrix in dict.fromkeys(row[0] for row in rows):
        entries = {(row[1], row[2]): (float(row[3]), row[4]) for row in rows if row[0] == matrix}
        inputs, states = (list(dict.fromkeys(place[axis] for place in entries)) for axis in (0, 1))
        if len(entries) != len(inputs) * len(states):
            raise ValueError(f"{matrix} lacks an entry; give a row for each")
        stored[matrix] = np.array([[entries[row, state][0] for state in states] for row in inputs])
        units = {place: _UNIT_OF_GAIN.fullmatch(unit) for place, (_, unit) in entries.items()}
        if matrix == "K":
            stored |= {"inputs": inputs, "states": states}
        if matrix == "K" and all(units.values()):
            stored["input_units"] = [units[name, states[0]][1] for name in inputs]  # type: ignore[index]
            stored["state_units"] = [units[inputs[0], name][2] for name in states]  # type: ignore[index]
    return stored


class _Table(NamedTuple):
    """Matrix in a .csv file, and the texts of its rows and of its columns, [] if it has none."""

    matrix: np.ndarray
    rows: list[str]
    columns: list[str]


def _table(name: str, path: Path) -> _Table:
    """Return the matrix in a .csv file, with the names of its rows and columns."""
    # A first row without a number contains the names of the columns. A first column without a
    # number contains the names of the rows. A list of names is empty if the file has none.
    # Raises ValueError for rows of different lengths, a file without rows of numbers, and a cell
    # that is not a number.
    with regular_file(path).open(encoding="utf-8-sig", newline="") as stream:
        rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
    _refuse_separators(name, rows)
    column_names: list[str] = []
    if rows and not any(map(_is_number, rows[0])):
        column_names = rows.pop(0)
    row_names: list[str] = []
    if rows and len(rows[0]) > 1:
        first_column = [row[0] for row in rows]
        if not any(map(_is_number, first_column)):
            row_names = first_column
            rows = [row[1:] for row in rows]
            column_names = column_names[1:]
    widths = {len(row) for row in rows}
    if column_names:
        widths.add(len(column_names))
    if not rows:
        raise ValueError(f"{name} has no numbers; give rows of numbers")
    if len(widths) > 1:
        cells = " and of ".join(map(str, sorted(widths)))
        raise ValueError(f"{name} has rows of {cells} cells; give rows of equal length")
    return _Table(np.array(rows, dtype=float), row_names, column_names)


def _refuse_separators(name: str, rows: list[list[str]]) -> None:
    """Raise ValueError if the numbers in a .csv file are not separated by commas."""
    for cell in (cell for row in rows for cell in row):
        of_table, by_blanks = re.split(r"[;\t]", cell), cell.split()
        is_table = len(of_table) > 1 and any(map(_is_number, of_table))
        if is_table or (len(by_blanks) > 1 and all(map(_is_number, by_blanks))):
            raise ValueError(
                f"{name} has the cell {shortened(cell)!r}; separate numbers by commas, and write "
                "decimals with a point"
            )


class _Label(NamedTuple):
    """Name of a row or a column, and its unit or ""."""

    name: str
    unit: str

    @classmethod
    def of(cls, text: str) -> _Label:
        """Return the label of a text such as "speed [ft/s]"."""
        ((name, unit),) = re.findall(r"^(.*?)\s*(?:\[(.*)\])?$", text.strip(), re.DOTALL)
        return cls(name, unit)


def _names_and_units(tables: Mapping[str, _Table]) -> dict[str, list[str]]:
    """Return the names and units of the states and inputs that .csv files contain.

    The result has the keys "states", "inputs", "state_units" and "input_units", as far as known.
    Names of states come from the matrix A, and names of inputs from the columns of B; of a critic,
    from P and K. Units are returned only if each state, or each input, has a unit.

    Raises ValueError if another matrix names the states in another order.
    """
    labels = {
        matrix: [[_Label.of(text) for text in texts] for texts in (table.rows, table.columns)]
        for matrix, table in tables.items()
    }
    rows_of_A, columns_of_A = labels.get("A", [[], []])
    rows_of_P, columns_of_P = labels.get("P", [[], []])
    rows_of_K, columns_of_K = labels.get("K", [[], []])
    _, columns_of_B = labels.get("B", [[], []])
    states_of_critic = rows_of_P or columns_of_P or columns_of_K
    found = {}
    for kind, signals in (
        ("state", rows_of_A or columns_of_A or states_of_critic),
        ("input", columns_of_B or rows_of_K),
    ):
        if signals:
            found[f"{kind}s"] = [label.name for label in signals]
        if signals and all(label.unit for label in signals):
            found[f"{kind}_units"] = [label.unit for label in signals]
    states = found.get("states", [])
    for matrix, both in labels.items():
        for side in _STATES.get(matrix, ()):
            names = [label.name for label in both[side]]
            if names != states and sorted(names) == sorted(states):
                where = f"the {('rows', 'columns')[side]} of {matrix}"
                raise ValueError(
                    f"{where} are {', '.join(names)}, but the states are {', '.join(states)}; give "
                    "them in this order"
                )
    return found


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
