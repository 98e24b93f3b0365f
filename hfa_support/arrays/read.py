"""Reading of named arrays from .json, .npz, .npy, .mat and .csv files."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError, prefix_errors, shortened
from hfa_support.files import read_json, regular_file, unpacked


def read_arrays(path: str | Path) -> dict[str, Any]:
    """Return the entries of a data file, name -> value. A structure is a nested mapping.

    - A .npy or .csv file contains one matrix, named by the file: W.npy, P.csv.
    - With A.csv or A.npy, the other matrices of the plant (B, ...) in the same folder are also
      read.
    - The matrix of a .npy file that is not named after a matrix of a plant or critic is stored
      under `one_matrix.UNKNOWN`.
    - In a .csv file, the first row and the first column may contain names, with units as in "speed
      [ft/s]".

    Raises BadInputError, which names the file, if the suffix is unknown or the file cannot be read.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in _READERS:
        raise BadInputError(
            f"{path}: the suffix {Path(path).suffix!r} is unknown; use {', '.join(_READERS)}"
        )
    try:
        # NumPy warns of headers that other programs write differently.
        with warnings.catch_warnings(action="ignore"):
            return _READERS[suffix](Path(path))
    except (FileNotFoundError, IsADirectoryError) as error:
        raise BadInputError(f"{path}: no such file; check the path") from error
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read ({error.strerror}); give a readable file"
        ) from error
    except BadInputError:
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
            array.tolist()  # ValueError for characters outside Unicode
    return entries


def _json(path: Path) -> dict[str, Any]:
    """Return the entries of a JSON object."""
    content = read_json(path)
    if not isinstance(content, dict):
        raise ValueError("the content is not an object with keys such as A and B")
    return content


def _npz(path: Path) -> dict[str, Any]:
    with prefix_errors(path):
        return arrays_of_npz(regular_file(path).read_bytes())


def _mat(path: Path) -> dict[str, Any]:
    from hfa_support.arrays.mat_file import structures

    return structures(path)


def _named_by_file(path: Path) -> dict[str, Any]:
    from hfa_support.arrays.one_matrix import matrices

    return matrices(path)


#: Suffix of `MATRIX_FILES` -> function from a path to the entries of the file.
_READERS: Mapping[str, Callable[[Path], dict[str, Any]]] = {
    ".json": _json,
    ".npz": _npz,
    ".npy": _named_by_file,
    ".mat": _mat,
    ".csv": _named_by_file,
}
