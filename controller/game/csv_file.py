"""Matrices in .csv files: plain ones, a file each, as pandas writes them; or all in one, as this project does."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.errors import shortened
from hfa_support.files import LARGEST_TEXT, regular_file

#: Of a plant, whose matrices lie in files beside A.csv, and of a critic.
PLANT, CRITIC = ("A", "B", "E", "Q", "R", "delta"), ("W", "P", "K")
_LONG = ("matrix", "row", "column", "value")
#: Which sides of a matrix, 0 its rows and 1 its columns, are the states.
_STATES = {"A": (0, 1), "B": (0,), "E": (0,), "Q": (0, 1), "P": (0, 1), "K": (1,)}
#: Names of the rows and of the columns of each matrix.
_Names = dict[str, tuple[list[str], list[str]]]


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
    names: _Names = {}
    matrices = {}
    for each in PLANT if name == "A" else (name,):
        place = Path(path).with_name(each + Path(path).suffix)
        if place == Path(path) or place.is_file():
            names[each], matrices[each] = _plain(each, rows if place == Path(path) else _rows(place))
    return _named(names) | matrices


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
    names: _Names = {}
    matrices = {}
    for name, cells in entries.items():
        if name not in (*PLANT, *CRITIC):
            continue  # offsets and outputs
        along, across = (list(dict.fromkeys(side)) for side in zip(*cells, strict=True))
        names[name] = along, across
        if len(cells) != len(along) * len(across):
            raise ValueError(f"{name} has {len(cells)} entries for {len(along)} rows and {len(across)} columns")
        matrices[name] = _numbers(name, [[cells[row, column] for column in across] for row in along])
    return _column_units(rows) | _named(names) | matrices


def _column_units(rows: list[list[str]]) -> dict[str, list[str]]:
    """Units of the states, the columns of A, P and K, from a column "unit": the last brackets of (rad)/(ft/s)."""
    if "unit" not in rows[0]:
        return {}
    places = [rows[0].index(name) for name in ("matrix", "column", "unit")]
    cells = ([line[place] for place in places] for line in rows[1:])
    last = {column: re.search(r"\(([^()]*)\)+$", unit) for matrix, column, unit in cells if matrix in "APK"}
    units = [match[1] for match in last.values() if match]
    return {"state_units": units} if len(units) == len(last) else {}


def _plain(name: str, rows: list[list[str]]) -> tuple[tuple[list[str], list[str]], np.ndarray]:
    """Names of rows and columns, empty where there are none, and the matrix."""
    if any(len(row) == 1 and re.search("[;\t]", row[0]) for row in rows):
        raise ValueError(f"{name} has its cells between semicolons or tabs; separate them by commas")
    columns: list[str] = []
    if rows and not any(map(is_number, rows[0])):
        columns, rows = rows[0], rows[1:]
    beside = [row[0] for row in rows] if rows and not any(is_number(row[0]) for row in rows) else []
    if beside:
        rows, columns = [row[1:] for row in rows], columns[1:]
    if not rows:
        raise ValueError(f"{name} has no entries")
    if len({len(row) for row in (*rows, *([columns] if columns else []))}) > 1:
        raise ValueError(f"{name} has rows that differ in length, or not one name for each column")
    return (beside, columns), _numbers(name, rows)


def _named(names: _Names) -> dict[str, list[str]]:
    """Names and units of states, from A, and inputs, from B. ValueError where the states are in another order."""
    found: dict[str, list[str]] = {}
    states, inputs = names.get("A", ([], [])), names.get("B", ([], []))[1]
    for kind, words in (("state", states[0] or states[1]), ("input", inputs)):
        units = [unit for _, unit in map(_parts, words) if unit]
        found |= {f"{kind}s": [name for name, _ in map(_parts, words)]} if words else {}
        found |= {f"{kind}_units": units} if words and len(units) == len(words) else {}
    known = found.get("states", [])
    for matrix, side in ((each, side) for each in names for side in _STATES.get(each, ())):
        here = [name for name, _ in map(_parts, names[matrix][side])]
        if here != known and sorted(here) == sorted(known):
            where = f"the {('rows', 'columns')[side]} of {matrix}"
            raise ValueError(f"{where} are {', '.join(here)} and A has {', '.join(known)}; give one order")
    return found


def _parts(words: str) -> tuple[str, str | None]:
    """Name and unit of "speed [ft/s]"."""
    name, unit = re.findall(r"^(.*?)\s*(?:\[(.*)\])?$", words.strip(), re.DOTALL)[0]
    return name, unit


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
