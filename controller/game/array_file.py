"""Arrays by name in .json, .npz, .mat and .csv files, whatever is in them: arrays, or one line that says why not.

A file may say its units: what was written in m is used in ft on a plant that is in ft."""

from __future__ import annotations

import sys
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller.game.basis import Basis
from controller.game.csv_file import read_csv
from controller.game.mat_file import read_mat
from hfa_model.vectors import LINEAR_STATES, LINEAR_UNITS
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import LARGEST, read_json, regular_file
from hfa_support.reporting.unit_system import si_factor, si_unit


def read_arrays(path: str | Path) -> dict[str, Any]:
    """Name -> value, of JSON as Python has it, else an array. Raises BadInputError, one line that names the file."""
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        raise BadInputError(f"{path}: the suffix {Path(path).suffix!r} is not known; use {', '.join(_READERS)}")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy on headers that it would have written otherwise
            return _READERS[suffix](path)
    except (FileNotFoundError, IsADirectoryError) as error:
        raise BadInputError(f"{path}: there is no such file") from error
    except OSError as error:
        raise BadInputError(f"{path}: cannot be read ({error.strerror})") from error
    except NotImplementedError as error:
        raise BadInputError(f"{path}: MATLAB 7.3 files cannot be read; save with the option -v7") from error
    except BadInputError:
        raise
    except Exception as error:  # a damaged file makes the readers raise nearly anything
        raise BadInputError(f"{path}: cannot be read as {suffix} ({_first_line(error)})") from error


def _json(path: str | Path) -> dict[str, Any]:
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError("it must be an object with keys such as A and B")
    return content


def _npz(path: str | Path) -> dict[str, Any]:
    with regular_file(path).open("rb") as file, zipfile.ZipFile(file) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > LARGEST:
            raise ValueError(f"it unpacks to more than {LARGEST >> 20} MiB")
        file.seek(0)
        with np.load(file, allow_pickle=False) as arrays:
            found = {key: arrays[key] for key in arrays.files}
    for key, array in found.items():
        if array.dtype.kind == "U" and array.nbytes:
            letters = np.ascontiguousarray(array).view(f"{array.dtype.str[0]}u4")
            if letters.max() > sys.maxunicode:  # printed, they end in an error of the interpreter
                raise ValueError(f"{shortened(key)} holds letters that are none")
    return found


_READERS: dict[str, Callable[[str | Path], dict[str, Any]]] = {
    ".json": _json,
    ".npz": _npz,
    ".mat": lambda path: read_mat(regular_file(path).read_bytes()),
    ".csv": read_csv,
}


def _first_line(error: Exception) -> str:
    lines = str(error).splitlines()
    return shortened(lines[0], 200) if lines else type(error).__name__


def real_array(name: str, value: Any) -> np.ndarray:
    """The value as floats. BadInputError where it is something else."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows that differ in length
        array = np.empty(0, dtype=object)
    if array.dtype.kind not in "iuf":
        raise BadInputError(f"{name} does not consist of rows of real numbers, all of one length")
    return array.astype(float)


def found_in(stored: dict[str, Any]) -> str:
    """For a message: the names in a file."""
    return f" (found: {shortened(', '.join(sorted(stored)), 200)})" if stored else " (the file is empty)"


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
    scales = np.ones(len(plant.state_units))
    units = words(stored, "state_units")
    if len(units) != len(plant.state_units):
        return scales
    for place, (unit, own) in enumerate(zip(units, plant.state_units, strict=True)):
        if "" in (unit, own) or unit == own:
            continue
        if si_unit(own) == unit:
            scales[place] = si_factor(own)
        elif si_unit(unit) == own:
            scales[place] = 1.0 / si_factor(unit)
        else:
            raise BadInputError(
                f"state {place + 1} is in {shortened(unit)} and that of the plant in {own}; convert it, or leave "
                "state_units out of the file"
            )
    return scales


def words(stored: Mapping[str, Any], key: str) -> tuple[str, ...]:
    """The texts of an entry; () where it holds anything else."""
    said = np.ravel(np.asarray(stored.get(key, ()), dtype=object)).tolist()  # of JSON: rows may differ in length
    return tuple(said) if all(isinstance(word, str) for word in said) else ()


def aircraft_scales(names: Mapping[str, tuple[str, ...]], size: int) -> np.ndarray:
    """s with x_file = s x, (size,), x in the units of the paper: of a plant with the aircraft's states; else 1."""
    if names.get("states") != LINEAR_STATES:
        return np.ones(size)
    try:
        return file_scales(names, PlantNames(state_units=LINEAR_UNITS))
    except BadInputError:
        return np.ones(size)


def in_scales(critic: Mapping[str, np.ndarray], scales: np.ndarray, functions: Basis | None) -> dict[str, np.ndarray]:
    """W ψ(s x), (s x)' P (s x) and K s x as functions of x: W (..., M), P (..., n, n), K (..., m, n) by name.

    functions: of W; what has not the shape of the plant stays as it is, and is refused where it is used.
    """
    found, n = dict(critic), len(scales)
    if "K" in found and found["K"].shape[-1] == n:
        found["K"] = found["K"] * scales
    if "P" in found and found["P"].shape[-2:] == (n, n):
        found["P"] = found["P"] * np.outer(scales, scales)
    if "W" in found and functions is not None and found["W"].shape[-1] == functions.size:
        found["W"] = found["W"] * functions.scaling(scales)
    return found
