"""Critics over time in files: .npz, .mat and .json by name, .csv by column."""

from __future__ import annotations

import contextlib
import csv
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import read_arrays
from controller.game.basis import basis
from controller.game.csv_file import holds_matrices
from controller.game.file_units import file_scales, in_scales
from controller.game.history import History, real_array
from controller.game.zero_sum import Game
from hfa_model.support.echo import shortened
from hfa_model.support.errors import BadInputError
from hfa_model.support.input_files import LARGEST_TEXT, regular_file

_TIMES = ("time", "times", "t")
_ALSO = {"weights": "W", "gains": "K"}


class _Shape(NamedTuple):
    """What one row is: its dimensions, and what it is called."""

    size: tuple[int, ...]
    what: str


def load_history(
    path: str | Path, game: Game, functions: str | None = None, state_units: tuple[str, ...] = ()
) -> History | None:
    """The history in a file, or None where it has no times and is a single critic.

    .npz, .mat, .json: `time` (or `times`, `t`) and W (N, M) (or `weights`), P (N, n, n) or K (N, m, n) (or `gains`);
    matrices also row by row, (N, m n), or as MATLAB stacks them, (m, n, N). .csv: a line for each time, the time first,
    then W1, W2, ... or the entries of K or P row by row; without names in the first line their number decides.
    functions: name of the basis of W; by default the one that the file names, or `quadratic`.
    state_units: of the plant; a file that says others is converted.
    Raises BadInputError, one line that names the file.
    """
    try:
        if Path(path).suffix.lower() == ".csv" and not _is_critic(path):
            return _of_table(*_read_csv(path), _shapes(game, functions or "quadratic"), functions or "quadratic")
        return _of_arrays(read_arrays(path), game, functions, state_units)
    except BadInputError as error:
        text = str(error)
        raise BadInputError(text if text.startswith(str(path)) else f"{path}: {text}") from error


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


def _of_arrays(
    stored: dict[str, Any], game: Game, functions: str | None, state_units: tuple[str, ...]
) -> History | None:
    named = {_ALSO.get(key, key): value for key, value in stored.items()}
    key = next((name for name in _TIMES if name in named), None)
    if key is None or not any(name in named for name in "WPK"):
        return None
    times = np.ravel(named[key])
    name = functions or (str(np.ravel(named["basis"])[0]) if "basis" in named else "quadratic")
    shapes = _shapes(game, name)
    rows = {each: _rows(each, named[each], len(times), shapes[each]) for each in "WPK" if each in named}
    if all(values.shape == shapes[each].size for each, values in rows.items()):
        return None
    scales = file_scales(stored, state_units)
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
    if lines and not _is_number(lines[0][1][0]):
        names = tuple(cell.strip() for cell in lines.pop(0)[1])
        if not names[0].lower().startswith("t"):
            raise BadInputError(
                f"the first column is {shortened(names[0])!r}; it must be the time, with commas between the columns"
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
            if not _is_number(row[column]):
                raise BadInputError(f"line {number}, column {column + 1} is {shortened(row[column])!r}; give a number")
    table = np.array([[row[column] for column in used] for _, row in lines], dtype=float)
    return tuple(names[column] for column in used) if names else (), table


def _of_table(names: tuple[str, ...], table: np.ndarray, shapes: dict[str, _Shape], functions: str) -> History:
    times, values = table[:, 0], table[:, 1:]
    count = values.shape[1]
    letters = {name[:1].upper() for name in names[1:]}
    if len(letters) > 1 and letters <= set(shapes):
        raise BadInputError(f"the columns are of {' and '.join(sorted(letters))}; give one of them")
    kinds = letters if len(letters) == 1 and letters <= set(shapes) else set(shapes)
    fitting = [kind for kind in kinds if np.prod(shapes[kind].size) == count]
    if not fitting:
        wanted = "; ".join(shapes[kind].what for kind in sorted(kinds))
        raise BadInputError(f"there are {count} columns beside the time; {wanted}")
    if len(fitting) > 1:
        raise BadInputError(f"{count} columns may be {' or '.join(sorted(fitting))}; name them, as in t,W1,W2")
    return History(times, **{fitting[0]: values.reshape(len(times), *shapes[fitting[0]].size)}, basis=functions)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
