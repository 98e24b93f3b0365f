"""Matrices in .csv files: plain ones, a file each, as pandas writes them; or all in one, as this project does."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.support.errors import shortened
from hfa_model.support.files import LARGEST_TEXT, regular_file

#: Of a plant, whose matrices lie in files beside A.csv, and of a critic.
PLANT, CRITIC = ("A", "B", "E", "Q", "R", "delta"), ("W", "P", "K")
_LONG = ("matrix", "row", "column", "value")


def read_csv(path: str | Path) -> dict[str, Any]:
    """Name -> matrix. A.csv: also B.csv, E.csv, Q.csv, R.csv, delta.csv beside it; K.csv, P.csv or W.csv: that one.

    A first row and a first column of words are names, with units as in "speed [ft/s]". A table with columns matrix,
    row, column, value holds several matrices. ValueError says what is wrong with the file.
    """
    rows = _rows(path)
    if rows and set(_LONG) <= set(rows[0]):
        return _long(rows)
    name = Path(path).stem
    if name not in (*PLANT[:1], *CRITIC):
        raise ValueError(
            f"a table without columns {', '.join(_LONG)} holds the matrix that its name says: A.csv with B.csv beside "
            "it, or K.csv, P.csv, W.csv"
        )
    found: dict[str, Any] = {}
    for each in PLANT if name == "A" else (name,):
        place = Path(path).with_name(each + Path(path).suffix)
        if place == Path(path) or place.is_file():
            found |= _plain(each, rows if place == Path(path) else _rows(place))
    return found


def holds_matrices(path: str | Path) -> bool:
    """Whether a file is one of these, and no table with the time in its first column."""
    first = next(iter(_rows(path)), [""])
    return set(_LONG) <= set(first) or (Path(path).stem in CRITIC and not first[0].lower().startswith("t"))


def _rows(path: str | Path) -> list[list[str]]:
    with regular_file(path, LARGEST_TEXT).open(encoding="utf-8-sig", newline="") as stream:
        return [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]


def _long(rows: list[list[str]]) -> dict[str, Any]:
    """Matrices from rows (matrix, row, column, value), in the order in which names of rows and columns come."""
    places = [rows[0].index(name) for name in _LONG]
    entries: dict[str, dict[tuple[str, str], str]] = {}
    for line in rows[1:]:
        if len(line) != len(rows[0]):
            raise ValueError(f"a row has {len(line)} cells and the header {len(rows[0])}")
        name, row, column, value = (line[place] for place in places)
        if (row, column) in entries.setdefault(name, {}):
            raise ValueError(f"{name}({row}, {column}) comes twice")
        entries[name][row, column] = value
    found: dict[str, Any] = {}
    for name, cells in entries.items():
        if name not in (*PLANT, *CRITIC):
            continue  # offsets and outputs
        names = [list(dict.fromkeys(pair[side] for pair in cells)) for side in (0, 1)]
        if len(cells) != len(names[0]) * len(names[1]):
            raise ValueError(f"{name} has {len(cells)} entries for {len(names[0])} rows and {len(names[1])} columns")
        matrix = [[cells[row, column] for column in names[1]] for row in names[0]]
        found |= _named(name, names[0], names[1]) | {name: _numbers(name, matrix)}
    return _column_units(rows) | found


def _column_units(rows: list[list[str]]) -> dict[str, list[str]]:
    """Units of the states, the columns of A, P and K, from a column "unit": the last brackets of (rad)/(ft/s)."""
    if "unit" not in rows[0]:
        return {}
    places = [rows[0].index(name) for name in ("matrix", "column", "unit")]
    cells = ([line[place] for place in places] for line in rows[1:])
    last = {column: re.search(r"\(([^()]*)\)+$", unit) for matrix, column, unit in cells if matrix in "APK"}
    units = [match[1] for match in last.values() if match]
    return {"state_units": units} if len(units) == len(last) else {}


def _plain(name: str, rows: list[list[str]]) -> dict[str, Any]:
    """A matrix with or without names."""
    columns: list[str] = []
    if rows and not all(map(is_number, rows[0][1:] or rows[0])):
        columns, rows = rows[0], rows[1:]
    beside = [row[0] for row in rows] if rows and not any(is_number(row[0]) for row in rows) else []
    if beside:
        rows, columns = [row[1:] for row in rows], columns[1:]
    if not rows:
        raise ValueError(f"{name} has no entries")
    if len({len(row) for row in (*rows, *([columns] if columns else []))}) > 1:
        raise ValueError(f"{name} has rows that differ in length, or not one name for each column")
    return _named(name, beside, columns) | {name: _numbers(name, rows)}


def _named(name: str, rows: list[str], columns: list[str]) -> dict[str, list[str]]:
    """Names and units of the states, from A, and of the inputs, from B."""
    words, kind = {"A": (rows or columns, "state"), "B": (columns, "input")}.get(name, ([], ""))
    parts = [re.fullmatch(r"(.*?)\s*(?:\[(.*)\])?", word.strip()) for word in words]
    units = [match[2] for match in parts if match and match[2]]
    found = {f"{kind}s": [match[1] for match in parts if match]} if words else {}
    return found | ({f"{kind}_units": units} if words and len(units) == len(words) else {})


def _numbers(name: str, rows: list[list[str]]) -> np.ndarray:
    for row in rows:
        for cell in row:
            if not is_number(cell):
                raise ValueError(f"{name} has an entry {shortened(cell)!r}; entries are numbers")
    return np.array([[float(cell) for cell in row] for row in rows])


def is_number(text: str) -> bool:
    """Whether Python reads it as a float."""
    try:
        float(text)
    except ValueError:
        return False
    return True
