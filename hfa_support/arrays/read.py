"""Named arrays of data files."""

from __future__ import annotations

import io
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.arrays.columns import Column, Label, columns_of_text, is_number
from hfa_support.errors import BadInputError, file_faults, prefix_errors, shortened
from hfa_support.files import LARGEST, read_json, regular_file, unpacked

#: Matrix -> what its rows and its columns are.
_SIDES = {
    **dict.fromkeys("AQP", ("state", "state")),
    **dict.fromkeys("BN", ("state", "input")),
    "E": ("state",),
    "R": ("input", "input"),
    "K": ("input", "state"),
}


class _Table(NamedTuple):
    """Matrix in a .csv file, and the labels of its rows and of its columns, [] if it has none."""

    matrix: np.ndarray
    rows: list[Label]
    columns: list[Label]


def _table(name: str, columns: Sequence[Column]) -> _Table:
    """Return the matrix of a table, whose first column may have the names of the rows.

    name: name of the matrix, for messages

    Raises ValueError for a table without numbers, and BadInputError for a cell that is none.
    """
    rows: list[Label] = []
    if len(columns) > 1 and not any(map(is_number, columns[0].cells)):
        rows = [*map(Label.of, columns[0].cells)]
        columns = columns[1:]
    if not len(columns[0].cells):
        raise ValueError(f"{name} has no numbers; give rows of numbers")
    headings = [Label(column.name, str(column.unit)) for column in columns if column.head]
    return _Table(np.column_stack([column.numbers() for column in columns]), rows, headings)


def _names_and_units(tables: Mapping[str, _Table]) -> dict[str, list[str]]:
    """Return "states", "inputs", "state_units" and "input_units", as far as .csv files state them.

    Units are returned only if each state, or each input, has a unit.

    Raises ValueError if a matrix has the states or inputs in another order.
    """
    stored: dict[str, list[str]] = {}
    for matrix, table in tables.items():
        sides = zip(_SIDES.get(matrix, ()), ("rows", "columns"), strict=False)
        for kind, side in sides:
            labels: list[Label] = getattr(table, side)
            if not labels:
                continue
            names = [label.name for label in labels]
            known = stored.setdefault(f"{kind}s", names)
            if names != known and sorted(names) == sorted(known):
                raise ValueError(
                    f"the {side} of {matrix} are {', '.join(names)}, but the {kind}s are "
                    f"{', '.join(known)}; give them in this order"
                )
            if all(label.unit for label in labels):
                stored.setdefault(f"{kind}_units", [label.unit for label in labels])
    return stored


#: Names of the matrices of a plant, in files next to A.csv, and of a critic.
PLANT = ("A", "B", "E", "Q", "R", "N", "delta")
CRITIC = ("W", "P", "K", "weights")
#: Name of the matrix in a .npy file that is not named after one of these.
UNKNOWN = "the array"


def matrices(path: Path) -> dict[str, Any]:
    """Return the matrices read from a .npy or .csv file, which contains one matrix, by their names.

    - a file named A: the result also contains the other matrices of the plant in the same folder
    - a .csv file: the result also contains the names and units of states and inputs in the file
    - a .npy file that is not named after a matrix of a plant or critic: its matrix has the name
      `UNKNOWN`

    Raises BadInputError as `_matrix_files` does.
    """
    is_csv = path.suffix.lower() == ".csv"
    is_named = path.stem in (*PLANT, *CRITIC)
    arrays, tables = {}, {}
    for name, file in (_matrix_files(path) if is_csv or is_named else {UNKNOWN: path}).items():
        with file_faults(file):
            if is_csv:
                content = regular_file(file).read_bytes()
                columns = columns_of_text(str(file), content, has_headings=False)
                tables[name] = _table(name, columns)
                arrays[name] = tables[name].matrix
            else:
                arrays[name] = np.load(regular_file(file), allow_pickle=False)
    return _names_and_units(tables) | arrays


def _matrix_files(path: Path) -> dict[str, Path]:
    """Return matrix -> its file. For a file named A, the other matrices of the plant in the same
    folder are included.

    Raises BadInputError for a file that is named after neither A nor a matrix of a critic.
    """
    if path.stem not in ("A", *CRITIC):
        raise BadInputError(
            f"{path}: a plant is read from A{path.suffix} (with B in the same folder), a critic "
            "from K, P or W; give such a file, or use .json, .npz or .mat"
        )
    files = {path.stem: path}
    if path.stem == "A":
        for name in PLANT:
            file = path.with_name(name + path.suffix)
            if file.is_file():
                files.setdefault(name, file)
    return files


#: Time limit of a child process, s; reading the largest .mat file takes a few seconds.
_TIME_LIMIT = 60.0
_CHILD_PROGRAM = Path(__file__).with_name("_loadmat.py")


def structures(path: Path) -> dict[str, Any]:
    """Return name -> array for the content of a .mat file. A structure is a nested mapping.

    A damaged file may crash or hang SciPy. The file is therefore read in a child process.

    Raises ValueError if the file cannot be read, or not within `_TIME_LIMIT` seconds.
    """
    command = [
        sys.executable,
        "-P",
        str(_CHILD_PROGRAM),
        str(regular_file(path).absolute()),
        str(LARGEST),
    ]
    try:
        child = subprocess.run(command, capture_output=True, timeout=_TIME_LIMIT)
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"reading takes longer than {_TIME_LIMIT:g} s; save the file as .npz"
        ) from error
    if child.returncode:
        message = ""
        if child.returncode == 1:
            message = child.stderr.decode("utf-8", "replace").strip()
        raise ValueError(message or "the file is damaged: SciPy crashes on it")
    content: dict[str, Any] = pickle.loads(child.stdout)  # of `_loadmat.py`, not of the file
    return content


def read_arrays(path: str | Path) -> dict[str, Any]:
    """Return the entries of a data file, name -> value. A structure is a nested mapping.

    - A .npy or .csv file contains one matrix, named by the file: W.npy, P.csv.
    - With A.csv or A.npy, the other matrices of the plant (B, ...) in the same folder are also
      read.
    - The matrix of a .npy file that is not named after a matrix of a plant or critic has the name
      `UNKNOWN`.
    - In a .csv file, the first row and the first column may contain names, with units as in "speed
      [ft/s]".

    Raises BadInputError, which names the file, if the suffix is unknown or the file cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        raise BadInputError(
            f"{path}: the suffix {Path(path).suffix!r} is unknown; use {', '.join(_READERS)}"
        )
    # NumPy warns of headers that other programs write differently.
    with warnings.catch_warnings(action="ignore"), file_faults(path):
        try:
            return _READERS[suffix](Path(path))
        except (BadInputError, OSError):
            raise
        except Exception as error:  # a damaged file makes the readers raise nearly anything
            reason = (str(error).splitlines() or [type(error).__name__])[0]
            raise BadInputError(
                f"{path} cannot be read as {suffix} ({shortened(reason, 200)}); correct the file"
            ) from error


def arrays_of_npz(content: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of a .npz file by name.

    Raises BadInputError for a damaged zip file, and ValueError for a member that is no array of
    numbers or texts.
    """
    entries = {
        name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(member), allow_pickle=False)
        for name, member in unpacked(content).items()
    }
    for array in entries.values():
        if array.dtype.kind == "U":
            array.tolist()  # raises ValueError for characters outside Unicode
    return entries


def _json(path: Path) -> dict[str, Any]:
    """Return the entries of a JSON object."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError("the content is not an object with keys such as A and B")
    return content


def _npz(path: Path) -> dict[str, Any]:
    """Return the arrays of a .npz file by name."""
    with prefix_errors(path):
        return arrays_of_npz(regular_file(path).read_bytes())


#: Suffix of `MATRIX_FILES` -> function from a path to the entries of the file.
_READERS: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    ".json": _json,
    ".npz": _npz,
    ".npy": matrices,
    ".mat": structures,
    ".csv": matrices,
}
