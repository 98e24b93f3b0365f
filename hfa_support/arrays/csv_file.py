"""Matrices from .csv files: one matrix per file, with optional names and units."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.errors import file_faults
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
    sides: dict[str, list[list[str]]] = {}
    matrices = {}
    for name, file in files.items():
        with file_faults(file):
            matrices[name], *sides[name] = _table(name, file)
    return _named(sides) | matrices


def _table(name: str, path: Path) -> tuple[np.ndarray, list[str], list[str]]:
    """Return the matrix in a .csv file, the names of its rows and the names of its columns."""
    # A first row without a number contains the names of the columns. A first column without a
    # number contains the names of the rows. A list of names is empty if the file has none.
    # Raises ValueError for rows of different lengths, a file without rows of numbers, and a cell
    # that is not a number.
    with regular_file(path).open(encoding="utf-8-sig", newline="") as stream:
        rows = [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]
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
    return np.array(rows, dtype=float), row_names, column_names


def _named(sides: Mapping[str, list[list[str]]]) -> dict[str, list[str]]:
    """Return the names and units of the states and inputs that .csv files contain."""
    # The result has the keys "states", "inputs", "state_units" and "input_units", as far as known.
    # Names of states come from the matrix A and names of inputs from the columns of B. Units are
    # returned only if each state, or each input, has a unit.
    # Raises ValueError if another matrix names the states in another order.
    parts = {
        name: [
            [re.findall(r"^(.*?)\s*(?:\[(.*)\])?$", word.strip(), re.DOTALL)[0] for word in side]
            for side in both
        ]
        for name, both in sides.items()
    }
    A = parts.get("A", [[], []])
    B = parts.get("B", [[], []])
    names = {}
    for kind, pairs in (("state", A[0] or A[1]), ("input", B[1])):
        if pairs:
            names[f"{kind}s"] = [name for name, _ in pairs]
        if pairs and all(unit for _, unit in pairs):
            names[f"{kind}_units"] = [unit for _, unit in pairs]
    of_A = names.get("states", [])
    for matrix, both in parts.items():
        for side in _STATES.get(matrix, ()):
            here = [name for name, _ in both[side]]
            if here != of_A and sorted(here) == sorted(of_A):
                where = f"the {('rows', 'columns')[side]} of {matrix}"
                raise ValueError(
                    f"{where} are {', '.join(here)}, but A has {', '.join(of_A)}; use A's order"
                )
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
