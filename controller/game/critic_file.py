"""Critics in files, once or over time: weights, value matrices and gains as a learner has written them down."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.array_file import (
    UNKNOWN,
    UNNAMED,
    PlantNames,
    file_scales,
    found_in,
    read_arrays,
    words,
)
from controller.game.basis import Basis, basis
from controller.game.zero_sum import LARGEST_CRITIC_ENTRY, Game, checked_matrix
from hfa_support.errors import BadInputError, numbers_in, said_of
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.unit_system import si_unit

#: What a critic consists of -> dimensions of one.
_NDIM = {"W": 1, "P": 2, "K": 2}
#: Other names of an entry.
_ALSO = {"weights": "W", "gains": "K", "times": "time", "t": "time"}


class StoredCritic(NamedTuple):
    """What a file says about a controller: weights W (M,), a value matrix P (n, n), a gain K (m, n); not all None."""

    W: np.ndarray | None
    P: np.ndarray | None
    K: np.ndarray | None


@dataclass(frozen=True, eq=False, repr=False)
class History(Shown):
    """times: (N,), s, increasing. W: (N, M) weights in `basis`, P: (N, n, n), K: (N, m, n); at least one of them.

    A single W (M,), P (n, n) or K (m, n) is that of the last row. BadInputError when a number is not finite or
    too large, the times do not increase from 0 on, or the number of rows differs.
    """

    times: np.ndarray
    W: np.ndarray | None = None
    P: np.ndarray | None = None
    K: np.ndarray | None = None
    basis: str = "quadratic"

    def __post_init__(self) -> None:
        """Name the first row that is wrong."""
        for name in ("times", *_NDIM):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, numbers_in(name.replace("times", "time"), value))
        times = self.times
        if times.ndim != 1 or not len(times):
            raise BadInputError(f"time has shape {times.shape}; give one time for each row")
        late = np.flatnonzero(np.diff(times) <= 0.0)
        if len(late):
            before, after = times[late[0] : late[0] + 2]
            raise BadInputError(f"time goes from {before:g} to {after:g} s at row {late[0] + 2}; it must increase")
        wrong = {"time is negative or not finite": ~(times >= 0.0) | ~np.isfinite(times)}
        for name in (rows := self._rows()):
            if len(rows[name]) != len(times):
                raise BadInputError(f"{name} has {len(rows[name])} rows and there are {len(times)} times")
            moderate = np.abs(rows[name].reshape(len(times), -1)) <= LARGEST_CRITIC_ENTRY
            wrong[f"{name} is not finite, or beyond {LARGEST_CRITIC_ENTRY:g},"] = ~moderate.all(axis=1)
        if not rows:
            raise BadInputError("a history needs W (rows of weights), P or K (a matrix for each time)")
        for what, where in wrong.items():
            for row in np.flatnonzero(where):
                raise BadInputError(f"{what} at row {row + 1} (t = {times[row]:g} s)")

    def row(self, index: int) -> StoredCritic:
        """What is known at one time; of the last row, -1, also its single matrices."""
        rows = self._rows()
        alone = {name: getattr(self, name) for name in _NDIM} if index == -1 else {}
        return StoredCritic(*(rows[name][index] if name in rows else alone.get(name) for name in _NDIM))

    def _rows(self) -> dict[str, np.ndarray]:
        given = {name: getattr(self, name) for name in _NDIM}
        return {name: each for name, each in given.items() if each is not None and each.ndim == _NDIM[name] + 1}


def critic_in(
    path: str | Path, game: Game, functions: str | None = None, plant: PlantNames = UNNAMED
) -> StoredCritic | History:
    """The history in a file, or where it has no times the single critic of `load_critic`.

    .npz, .mat, .json: `time` (or `times`, `t`) and W (N, M) (or `weights`), P (N, n, n) or K (N, m, n) (or `gains`);
    matrices also row by row, (N, m n), or as MATLAB stacks them, (m, n, N). .csv: a line for each time, the time first,
    then W1, W2, ... or the entries of K or P row by row; without names in the first line their number decides. Behind
    the names of weights may be their units in brackets, as `hfa learn` writes them. An array without a name is what its
    shape says.
    functions: name of the basis of W; by default the one that the file names, or `quadratic`.
    A file that says other units than the plant is converted. Raises BadInputError, one line that names the file.
    """
    stored = read_arrays(path)
    with said_of(path):
        if UNKNOWN in stored:
            stored = {_by_shape(stored[UNKNOWN], game): stored[UNKNOWN]}
        history = _history(stored, game, functions, plant)
        return history or _single(stored, plant, basis(functions or "quadratic", len(game.A)))


def _by_shape(array: np.ndarray, game: Game) -> str:
    """W, P or K, which the shape of an array without a name is."""
    fitting = [name for name, shape in (("P", game.A.shape), ("K", game.B.T.shape)) if array.shape == shape]
    fitting = fitting or ["W"] * (max(array.shape, default=1) == array.size)
    if len(fitting) != 1:
        said = " or ".join(fitting) or "neither weights, nor P, nor K of this plant"
        raise BadInputError(f"the array of shape {array.shape} is {said}; name the file W.npy, P.npy or K.npy")
    return fitting[0]


def load_critic(path: str | Path, plant: PlantNames = UNNAMED, functions: Basis | None = None) -> StoredCritic:
    """The critic in a file: its W (or `weights`), P and K, as many as it holds. Raises BadInputError, one line.

    A file that says other units than the plant is converted, W as weights of `functions`.
    """
    stored = read_arrays(path)
    with said_of(path):
        return _single(stored, plant, functions)


def _single(stored: dict[str, Any], plant: PlantNames, functions: Basis | None) -> StoredCritic:
    named = {_ALSO.get(key, key): stored[key] for key in (*_ALSO, *stored) if key in stored}
    given = {key: numbers_in(key, named[key]) for key in _NDIM if key in named}
    if not given:
        raise BadInputError(f"there is no W, P or K; a weights file holds one of them{found_in(stored)}")
    for key, values in given.items():
        if not values.size or (key == "W" and max(values.shape, default=1) != values.size):
            raise BadInputError(f"{key} has shape {values.shape}; weights are one row or one column, P and K matrices")
        given[key] = checked_matrix(key, values.reshape(-1) if key == "W" else values, LARGEST_CRITIC_ENTRY, _NDIM[key])
    given = in_scales(given, file_scales(stored, plant), functions)
    return StoredCritic(**{key: given.get(key) for key in _NDIM})


def in_scales(critic: dict[str, np.ndarray], scales: np.ndarray, functions: Basis | None) -> dict[str, np.ndarray]:
    """W ψ(s x), (s x)' P (s x) and K s x as functions of x: W (..., M), P (..., n, n), K (..., m, n) by name.

    functions: of W; an array of another shape than the plant's is kept, and refused where it is used.
    """
    found, n = dict(critic), len(scales)
    if np.all(scales == 1.0):
        return found
    if "K" in found and found["K"].shape[-1] == n:
        found["K"] = found["K"] * scales
    if "P" in found and found["P"].shape[-2:] == (n, n):
        found["P"] = found["P"] * np.outer(scales, scales)
    if "W" in found and functions is not None and found["W"].shape[-1] == functions.size:
        found["W"] = found["W"] * functions.scaling(scales)
    return found


def _history(stored: dict[str, Any], game: Game, functions: str | None, plant: PlantNames) -> History | None:
    # Beside the rows over time a file may hold the last of them.
    stored = stored | {_ALSO[key]: stored[key] for key in _ALSO if key in stored}
    if "time" not in stored or not {*_NDIM, "columns"} & set(stored):
        return None
    times = np.ravel(numbers_in("time", stored["time"]))
    said = words(stored, "basis") if "basis" in stored else ("quadratic",)
    if functions is None and len(said) != 1:
        raise BadInputError("basis must be one name, such as 'quadratic'")
    (n, m), psi = game.B.shape, basis(functions or said[0], len(game.A))
    sizes = {"W": (psi.size,), "P": (n, n), "K": (m, n)}
    rows = {key: stored[key] for key in _NDIM if key in stored}
    if "columns" in stored:
        count = stored["columns"].shape[1]
        fitting = [key for key, size in sizes.items() if math.prod(size) == count]
        if len(fitting) != 1:
            which = (
                f"may be {' or '.join(fitting)}" if fitting else f"are not W ({psi.size}), P ({n * n}) or K ({m * n})"
            )
            raise BadInputError(f"the {count} columns beside the time {which}; name them, as in t,W1,W2")
        rows = {fitting[0]: stored["columns"]}
    said_of_W = f"basis {psi.name!r} on {n} states has {psi.size} weights"
    found = {key: _rows(key, value, len(times), sizes[key], said_of_W) for key, value in rows.items()}
    if all(values.shape == sizes[key] for key, values in found.items()):
        return None
    # Units of columns like "W1 [1/((m/s) (m/s))]": those of the plant unless all say the SI ones.
    si = tuple(map(si_unit, plant.state_units))
    if any(si) and stored.get("units of W") == psi.weight_units(si):
        stored = {**stored, "state_units": si}
    return History(times, **in_scales(found, file_scales(stored, plant), psi), basis=psi.name)


def _rows(name: str, value: Any, count: int, size: tuple[int, ...], said: str) -> np.ndarray:
    """(N, *size), or the matrix of the last row alone."""
    array = numbers_in(name, value)
    if array.shape in ((count, *size), size):
        return array
    if len(size) == 2 and array.shape == (*size, count):
        return np.moveaxis(array, -1, 0)
    if array.shape == (count, math.prod(size)):
        return array.reshape(count, *size)
    found, wanted = (" x ".join(map(str, each)) for each in (array.shape, (count, *size)))
    of = f"{said} and there" if name == "W" else "there"
    raise BadInputError(f"{name} is {found}; {of} are {count} times, so it must be {wanted}")
