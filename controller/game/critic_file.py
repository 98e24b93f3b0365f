"""Critics in files, once or over time: .npz, .mat and .json by name, .csv by column."""

from __future__ import annotations

import contextlib
import csv
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import (
    UNNAMED,
    PlantNames,
    file_scales,
    found_in,
    in_scales,
    read_arrays,
    real_array,
    words,
)
from controller.game.basis import Basis, basis
from controller.game.csv_file import holds_matrices, is_number
from controller.game.history import LARGEST_CRITIC_ENTRY, History, StoredCritic
from controller.game.zero_sum import Game
from hfa_support.errors import BadInputError, said_of, shortened
from hfa_support.files import LARGEST_TEXT, regular_file
from hfa_support.reporting.unit_system import si_unit

_TIMES = ("time", "times", "t")
_ALSO = {"weights": "W", "gains": "K"}
#: Said of a table that is no history.
_ALONE = "a matrix without times goes into a file called P.csv or K.csv, weights into W.csv"


class _Shape(NamedTuple):
    """What one row is: its dimensions, and what it is called."""

    size: tuple[int, ...]
    what: str


def critic_in(
    path: str | Path, game: Game, functions: str | None = None, plant: PlantNames = UNNAMED
) -> StoredCritic | History:
    """`load_history` of a file with times, else `load_critic`; the file is read once."""
    history, stored = _history(path, game, functions, plant)
    return history or _once(path, stored, plant, basis(functions or "quadratic", len(game.A)))


def load_history(
    path: str | Path, game: Game, functions: str | None = None, plant: PlantNames = UNNAMED
) -> History | None:
    """The history in a file, or None where it has no times and is a single critic.

    .npz, .mat, .json: `time` (or `times`, `t`) and W (N, M) (or `weights`), P (N, n, n) or K (N, m, n) (or `gains`);
    matrices also row by row, (N, m n), or as MATLAB stacks them, (m, n, N). .csv: a line for each time, the time first,
    then W1, W2, ... or the entries of K or P row by row; without names in the first line their number decides. Behind
    the names of weights may stand their units in brackets, as `hfa learn` writes them.
    functions: name of the basis of W; by default the one that the file names, or `quadratic`.
    A file that says other units than the plant is converted.
    Raises BadInputError, one line that names the file.
    """
    return _history(path, game, functions, plant)[0]


def _history(
    path: str | Path, game: Game, functions: str | None, plant: PlantNames
) -> tuple[History | None, dict[str, Any]]:
    """`load_history`, and what the file holds."""
    with said_of(path):
        if Path(path).suffix.lower() == ".csv" and not _is_critic(path):
            name = functions or "quadratic"
            return _of_table(*_read_csv(path), _shapes(game, name), name, plant), {}
        stored = read_arrays(path)
        return _of_arrays(stored, game, functions, plant), stored


def load_critic(path: str | Path, plant: PlantNames = UNNAMED, functions: Basis | None = None) -> StoredCritic:
    """The critic in a file: its W, P and K, as many as it holds. Raises BadInputError, one line.

    A file that says other units than the plant is converted, W as weights of `functions`.
    """
    return _once(path, read_arrays(path), plant, functions)


def _once(path: str | Path, stored: dict[str, Any], plant: PlantNames, functions: Basis | None) -> StoredCritic:
    if not any(key in stored for key in StoredCritic._fields):
        raise BadInputError(f"{path}: there is no W, P or K; a weights file holds one of them{found_in(stored)}")
    parts = {key: _part(path, key, stored[key]) for key in StoredCritic._fields if key in stored}
    with said_of(path):
        scales = file_scales(stored, plant)
    if np.any(scales != 1.0):
        parts = in_scales(parts, scales, functions)
    return StoredCritic(**{key: parts.get(key) for key in StoredCritic._fields})


def _part(path: str | Path, key: str, value: Any) -> np.ndarray:
    values = _numbers(path, key, value)
    if key == "W":
        if max(values.shape, default=1) != values.size:
            raise BadInputError(f"{path}: W has shape {values.shape}; weights are one row or one column")
        values = values.reshape(-1)
    elif values.ndim != 2:
        raise BadInputError(f"{path}: {key} has {values.ndim} dimension(s); it must be a matrix")
    if np.abs(values).max() > LARGEST_CRITIC_ENTRY:
        raise BadInputError(
            f"{path}: {key} has an entry of {np.abs(values).max():g}; entries must not exceed {LARGEST_CRITIC_ENTRY:g}"
        )
    values.setflags(write=False)
    return values


def _numbers(path: str | Path, name: str, value: Any) -> np.ndarray:
    try:
        array = np.array(value)
    except ValueError as error:
        raise BadInputError(f"{path}: {name} has rows that differ in length") from error
    if array.dtype.kind not in "iuf":
        what = "is complex; give its real part" if array.dtype.kind == "c" else "does not consist of real numbers"
        raise BadInputError(f"{path}: {name} {what}")
    if array.size == 0 or not np.all(np.isfinite(array)):
        raise BadInputError(f"{path}: {name} is empty or has entries that are not finite")
    return array.astype(float)


def _is_critic(path: str | Path) -> bool:
    """Whether a .csv holds matrices; what cannot be read is told by the reader of tables."""
    with contextlib.suppress(OSError, ValueError):
        return holds_matrices(path)
    return False


def _shapes(game: Game, functions: str) -> dict[str, _Shape]:
    n, m = game.B.shape
    psi = basis(functions, n)
    return {
        "W": _Shape((psi.size,), f"basis {psi.name!r} on {n} states has {psi.size} weights"),
        "P": _Shape((n, n), f"P is {n} x {n}"),
        "K": _Shape((m, n), f"K is {m} x {n}"),
    }


def _of_arrays(stored: dict[str, Any], game: Game, functions: str | None, plant: PlantNames) -> History | None:
    named = {_ALSO.get(key, key): value for key, value in stored.items()}
    key = next((name for name in _TIMES if name in named), None)
    if key is None or not any(name in named for name in "WPK"):
        return None
    times = np.ravel(real_array("time", named[key]))
    said = words(named, "basis") if "basis" in named else ("quadratic",)
    if functions is None and len(said) != 1:
        raise BadInputError("basis must be one name, such as 'quadratic'")
    name = functions or said[0]
    shapes = _shapes(game, name)
    rows = {each: _rows(each, named[each], len(times), shapes[each]) for each in "WPK" if each in named}
    if all(values.shape == shapes[each].size for each, values in rows.items()):
        return None
    scales = file_scales(stored, plant)
    if np.any(scales != 1.0):
        rows = in_scales(rows, scales, basis(name, len(scales)))
    return History(times, **rows, basis=name)


def _rows(name: str, value: Any, count: int, shape: _Shape) -> np.ndarray:
    """(N, *shape), or the matrix of the last row alone as it is."""
    array, size = real_array(name, value), shape.size
    if array.shape in ((count, *size), size):
        return array
    if len(size) == 2 and array.shape == (*size, count):
        return np.moveaxis(array, -1, 0)
    if array.shape == (count, int(np.prod(size))):
        return array.reshape(count, *size)
    found, wanted = (" x ".join(map(str, each)) for each in (array.shape, (count, *size)))
    raise BadInputError(f"{name} is {found}; {shape.what} and there are {count} times, so it must be {wanted}")


def _read_csv(path: str | Path) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the columns, () without a first line of names, and the numbers, (N, columns).

    Where some columns are named W1 ..., K11 ... or P11 ..., the others but the first are left out.
    """
    try:
        text = regular_file(path, LARGEST_TEXT).read_text(encoding="utf-8-sig")
    except (FileNotFoundError, IsADirectoryError) as error:
        raise BadInputError("there is no such file") from error
    except OSError as error:
        raise BadInputError(f"cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise BadInputError("is not text") from error
    try:
        lines = [(number, row) for number, row in enumerate(csv.reader(text.splitlines()), start=1) if any(row)]
    except csv.Error as error:
        raise BadInputError(f"cannot be read as .csv ({error})") from error
    names: tuple[str, ...] = ()
    if lines and not is_number(lines[0][1][0]):
        names = tuple(cell.strip() for cell in lines.pop(0)[1])
        if not names[0].lower().startswith("t"):
            raise BadInputError(
                f"the first column is {shortened(names[0])!r}; it must be the time, with commas between the columns; "
                + _ALONE
            )
    if not lines:
        raise BadInputError("there are no rows of numbers")
    width = len(names or lines[0][1])
    entries = [column for column, name in enumerate(names) if column and re.match(r"[WPK][\d_( ]", name)]
    used = [0, *(entries or range(1, width))]
    for number, row in lines:
        if len(row) != width:
            raise BadInputError(f"line {number} has {len(row)} columns, the first one has {width}")
        for column in used:
            if not is_number(row[column]):
                raise BadInputError(f"line {number}, column {column + 1} is {shortened(row[column])!r}; give a number")
    table = np.array([[row[column] for column in used] for _, row in lines], dtype=float)
    return tuple(names[column] for column in used) if names else (), table


def _of_table(
    names: tuple[str, ...],
    table: np.ndarray,
    shapes: dict[str, _Shape],
    functions: str,
    plant: PlantNames,
) -> History:
    times, values = table[:, 0], table[:, 1:]
    count = values.shape[1]
    letters = {name[:1].upper() for name in names[1:]}
    if len(letters) > 1 and letters <= set(shapes):
        raise BadInputError(f"the columns are of {' and '.join(sorted(letters))}; give one of them")
    kinds = letters if len(letters) == 1 and letters <= set(shapes) else set(shapes)
    fitting = [kind for kind in kinds if np.prod(shapes[kind].size) == count]
    if not fitting:
        wanted = "; ".join(shapes[kind].what for kind in sorted(kinds))
        raise BadInputError(f"there are {count} columns beside the time; {wanted}; {_ALONE}")
    if len(fitting) > 1:
        raise BadInputError(f"{count} columns may be {' or '.join(sorted(fitting))}; name them, as in t,W1,W2")
    kind = fitting[0]
    rows = {kind: values.reshape(len(times), *shapes[kind].size)}
    if kind == "W" and any(plant.state_units):
        psi = basis(functions, len(plant.state_units))
        said = {"state_units": _units_of(names[1:], psi, plant.state_units)}
        rows = in_scales(rows, file_scales(said, plant), psi)
    return History(times, **rows, basis=functions)


def _units_of(names: tuple[str, ...], psi: Basis, state_units: tuple[str, ...]) -> tuple[str, ...]:
    """State units of columns like "W1 [1/((m/s) (m/s))]": those of the plant unless all say the SI ones."""
    si = tuple(map(si_unit, state_units))
    said = [name.partition("[")[2].removesuffix("]") for name in names]
    return si if said == psi.weight_units(si) else state_units
