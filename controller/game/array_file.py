"""Arrays by name in .json, .npz, .npy, .mat and .csv files: one reader a format, one mapping name -> value.

Whatever a file holds, the answer is that mapping or one line that names the fault of the file.
"""

from __future__ import annotations

import csv
import io
import json
import re
import subprocess
import sys
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, shortened
from hfa_support.files import LARGEST, LARGEST_TEXT, MATRIX_FILES, read_json, regular_file
from hfa_support.reporting.unit_system import si_factor, si_unit

#: Of a plant, in files beside A.csv, and of a critic: what a .csv or .npy file without names in it holds by its own.
PLANT = ("A", "B", "E", "Q", "R", "delta", "B1", "B2", "C1", "C2", "D11", "D12", "D21", "D22")
CRITIC = ("W", "P", "K", "weights")
#: What an .npy file of another name holds.
UNKNOWN = "the array"
#: Entries whose words are printed: names of states and inputs, and their units.
_PRINTED = ("states", "inputs", "state_labels", "input_labels", "state_units", "input_units")
#: Header of a .csv with several matrices.
_LONG = ("matrix", "row", "column", "value")
#: Which sides of a matrix, 0 its rows and 1 its columns, are the states.
_STATES = {"A": (0, 1), "B": (0,), "E": (0,), "Q": (0, 1), "P": (0, 1), "K": (1,)}
#: s; a .mat file of 1 GiB takes a few.
_LONGEST = 60.0
_CHILD = Path(__file__).with_name("_loadmat.py")


def read_arrays(path: str | Path) -> dict[str, Any]:
    """Name -> array, of JSON as Python has it, of a structure a mapping. BadInputError, one line that names the file.

    .npy and plain .csv: a matrix under the name of the file, W.npy or P.csv; A.csv with B.csv and so on beside it;
    of an .npy file of any other name under `UNKNOWN`.
    .csv: a first row and a first column of words are names, with units as in "speed [ft/s]"; columns matrix, row,
    column, value hold several matrices; any other table is `time` and columns W1 ..., K11 ..., P11 ..., else `columns`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        raise BadInputError(f"{path}: the suffix {Path(path).suffix!r} is not known; use {', '.join(_READERS)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy on headers that it would have written otherwise
            found = _READERS[suffix](Path(path))
            for key in _PRINTED:
                for word in words(found, key):
                    if not word.isprintable():
                        raise ValueError(f"{key} has the name {shortened(ascii(word))}, which cannot be printed")
            return found
    except (FileNotFoundError, IsADirectoryError) as error:
        raise BadInputError(f"{path}: there is no such file") from error
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except BadInputError:
        raise
    except Exception as error:  # a damaged file makes the readers raise nearly anything
        said = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadInputError(f"{path}: cannot be read as {suffix} ({shortened(said, 200)})") from error


def _json(path: Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError("it must be an object with keys such as A and B")
    return content


def _npz(path: Path) -> dict[str, Any]:
    with regular_file(path).open("rb") as file, zipfile.ZipFile(file) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > LARGEST:
            raise ValueError(f"it unpacks to more than {LARGEST >> 20} MiB")
        file.seek(0)
        with np.load(file, allow_pickle=False) as arrays:
            found = {key: arrays[key] for key in arrays.files}
    for array in found.values():
        if array.dtype.kind == "U":
            array.tolist()  # ValueError for letters beyond Unicode
    return found


def _npy(path: Path) -> dict[str, Any]:
    if path.stem not in (*PLANT, *CRITIC):
        return {UNKNOWN: np.load(regular_file(path), allow_pickle=False)}
    return {name: np.load(regular_file(each), allow_pickle=False) for name, each in _beside(path).items()}


def _mat(path: Path) -> dict[str, Any]:
    """As SciPy reads it in a child process, which a damaged file may crash or hang."""
    words_of_child = [sys.executable, "-P", str(_CHILD), str(regular_file(path).absolute()), str(LARGEST)]
    try:
        done = subprocess.run(words_of_child, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired as error:
        raise ValueError(f"reading it takes longer than {_LONGEST:g} s") from error
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip() if done.returncode == 1 else ""
        raise ValueError(said or "it is damaged: SciPy crashes on it")
    found: dict[str, Any] = {}
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        for place, (*above, name) in enumerate(json.loads(str(arrays["paths"]))):
            inside = found
            for each in above:
                inside = inside.setdefault(each, {})
            inside[name] = arrays[str(place)]
    return found


def _beside(path: Path) -> dict[str, Path]:
    """Name -> file of the matrices that belong together without names inside."""
    if path.stem not in (*PLANT[:1], *CRITIC):
        raise ValueError("it holds the matrix that its name says: A with B beside it, or K, P, W; rename it")
    others = [path.with_name(name + path.suffix) for name in PLANT] if path.stem == "A" else []
    return {path.stem: path, **{each.stem: each for each in others if each.is_file() and each != path}}


def _csv(path: Path) -> dict[str, Any]:
    rows = _cells(path)
    first = rows[0] if rows else [""]
    if set(_LONG) <= set(first):
        return _entry_by_entry(rows)
    if path.stem not in (*PLANT[:1], *CRITIC) or first[0].strip().lower().startswith("t"):
        return _over_time(rows)
    sides, matrices = {}, {}
    for name, each in _beside(path).items():
        matrices[name], *sides[name] = _plain(name, rows if each == path else _cells(each))
    return _named(sides) | matrices


def _cells(path: Path) -> list[list[str]]:
    with regular_file(path, LARGEST_TEXT).open(encoding="utf-8-sig", newline="") as stream:
        return [row for row in csv.reader(stream) if any(cell.strip() for cell in row)]


def _entry_by_entry(rows: list[list[str]]) -> dict[str, Any]:
    """Matrices from rows (matrix, row, column, value), in the order in which names of rows and columns come.

    A column "unit" says the units of the states, by the columns of A, P and K: the last brackets of (rad)/(ft/s).
    """
    tables: dict[str, dict[tuple[str, str], str]] = {}
    sides, matrices, units = {}, {}, {}
    for line in rows[1:]:
        if len(line) != len(rows[0]):
            raise ValueError(f"a row has {len(line)} cells and the header {len(rows[0])}")
        entry = dict(zip(rows[0], line, strict=True))
        name, row, column, value = (entry[key] for key in _LONG)
        if (row, column) in tables.setdefault(name, {}):
            raise ValueError(f"{name}({row}, {column}) comes twice")
        tables[name][row, column] = value
        if name in ("A", "P", "K") and (match := re.search(r"\(([^()]*)\)+$", entry.get("unit", ""))):
            units[column] = match[1]
    for name, cells in tables.items():
        if name not in (*PLANT, *CRITIC):  # offsets and outputs
            continue
        rows_of, columns = (list(dict.fromkeys(side)) for side in zip(*cells, strict=True))
        if len(cells) != len(rows_of) * len(columns):
            raise ValueError(f"{name} has {len(cells)} entries for {len(rows_of)} rows and {len(columns)} columns")
        matrices[name] = _numbers(name, [[cells[row, each] for each in columns] for row in rows_of], len(columns))
        sides[name] = [rows_of, columns]
    return {"state_units": list(units.values())} | _named(sides) | matrices


def _plain(name: str, rows: list[list[str]]) -> tuple[np.ndarray, list[str], list[str]]:
    """The matrix, and the names of its rows and columns, [] where it has none."""
    columns: list[str] = []
    if rows and not any(map(_is_number, rows[0])):
        columns, rows = rows[0], rows[1:]
    beside = [row[0] for row in rows] if rows and len(rows[0]) > 1 else []
    if any(map(_is_number, beside)):
        beside = []
    if beside:
        rows, columns = [row[1:] for row in rows], columns[1:]
    return _numbers(name, rows, len(columns or next(iter(rows), []))), beside, columns


def _named(sides: Mapping[str, list[list[str]]]) -> dict[str, list[str]]:
    """Names and units of states, from A, and inputs, from B. ValueError where the states are in another order."""
    parts = {
        name: [[re.findall(r"^(.*?)\s*(?:\[(.*)\])?$", word.strip(), re.DOTALL)[0] for word in side] for side in both]
        for name, both in sides.items()
    }
    A, B = parts.get("A", [[], []]), parts.get("B", [[], []])
    found = {}
    for kind, pairs in (("state", A[0] or A[1]), ("input", B[1])):
        if pairs:
            found[f"{kind}s"] = [name for name, _ in pairs]
        if pairs and all(unit for _, unit in pairs):
            found[f"{kind}_units"] = [unit for _, unit in pairs]
    known = found.get("states", [])
    for matrix, both in parts.items():
        for side in _STATES.get(matrix, ()):
            here = [name for name, _ in both[side]]
            if here != known and sorted(here) == sorted(known):
                where = f"the {('rows', 'columns')[side]} of {matrix}"
                raise ValueError(f"{where} are {', '.join(here)} and A has {', '.join(known)}; give one order")
    return found


def _over_time(rows: list[list[str]]) -> dict[str, Any]:
    """`time`, from the first column, and the columns named W1 ..., K11 ... or P11 ... by letter, else all others."""
    names: list[str] = []
    if rows and not _is_number(rows[0][0]):
        names, rows = [cell.strip() for cell in rows[0]], rows[1:]
        if not names[0].lower().startswith("t"):
            alone = "a matrix without times goes into a file called A.csv, P.csv or K.csv, weights into W.csv"
            raise ValueError(f"the first column is {shortened(names[0])!r}; it must be the time; {alone}")
    used = [place for place, name in enumerate(names) if re.match(r"[WPK][\d_( ]", name)]
    width = len(names or next(iter(rows), []))
    table = _numbers("the table", rows, width, [0, *(used or range(1, width))])
    if not used:
        return {"time": table[:, 0], "columns": table[:, 1:]}
    found: dict[str, Any] = {"time": table[:, 0]}
    for letter in dict.fromkeys(names[place][0] for place in used):
        columns = {column: names[place] for column, place in enumerate(used, start=1) if names[place][0] == letter}
        found[letter] = table[:, list(columns)]
        found[f"units of {letter}"] = [name.partition("[")[2].removesuffix("]") for name in columns.values()]
    return found


def _numbers(name: str, rows: list[list[str]], width: int, used: list[int] | None = None) -> np.ndarray:
    """The numbers in these columns, by default in all, of rows of `width` cells."""
    if not rows:
        raise ValueError(f"{name} has no numbers")
    places = range(width) if used is None else used
    for line, row in enumerate(rows, start=1):
        if len(row) != width:
            raise ValueError(f"{name} has {len(row)} cells in row {line} of numbers and {width} before")
        for place in places:
            if not _is_number(row[place]):
                cell = f"{shortened(row[place])!r} in row {line} of numbers, column {place + 1}"
                raise ValueError(f"{name} has {cell}; give numbers, with commas between them")
    return np.array([[float(row[place]) for place in places] for row in rows])


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


_READERS: Mapping[str, Callable[[Path], dict[str, Any]]] = dict(
    zip(MATRIX_FILES, (_json, _npz, _npy, _mat, _csv), strict=True)
)


def found_in(stored: Mapping[str, Any]) -> str:
    """For a message: the names in a file."""
    return f" (found: {shortened(', '.join(sorted(stored)), 200)})" if stored else " (the file is empty)"


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """The texts of an entry; () where it holds anything else."""
    said = np.ravel(np.asarray(stored.get(key, ()), dtype=object)).tolist()  # of JSON: rows may differ in length
    return tuple(said) if all(isinstance(word, str) for word in said) else ()


class PlantNames(NamedTuple):
    """What a plant calls its states and inputs, and the units of the states; () where it does not say."""

    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    state_units: tuple[str, ...] = ()


UNNAMED = PlantNames()


def file_scales(stored: Mapping[str, Any], plant: PlantNames) -> np.ndarray:
    """s with x_file = s x, (n,), from the entry `state_units`; ones where the file or the plant says no units.

    BadInputError for units that are neither the plant's nor their SI or English ones, and where `states` or `inputs`
    of the file are the plant's in another order.
    """
    for key in ("states", "inputs"):
        said, own = words(stored, key), getattr(plant, key)
        if said != own and sorted(said) == sorted(own):
            raise BadInputError(
                f"its {key} are in the order {shortened(', '.join(said), 200)}; those of the plant are "
                f"{shortened(', '.join(own), 200)}: reorder the matrices, or leave {key} out of the file"
            )
    scales, units = np.ones(len(plant.state_units)), words(stored, "state_units")
    if len(units) != len(scales):
        return scales
    for place, (unit, own) in enumerate(zip(units, plant.state_units, strict=True)):
        if si_unit(own) == unit != own:
            scales[place] = si_factor(own)
        elif si_unit(unit) == own != unit:
            scales[place] = 1.0 / si_factor(unit)
        elif "" not in (unit, own) and unit != own:
            raise BadInputError(
                f"state {place + 1} is in {shortened(unit)} and that of the plant in {own}; convert it, or leave "
                "state_units out of the file"
            )
    return scales
