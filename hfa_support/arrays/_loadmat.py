"""Child process of `mat_file` that writes the content of a .mat file to standard output, pickled.

SciPy 1.17 crashes on 36 of 6,000 files of which up to eight bytes were changed, and hangs on one.
This program imports nothing of the project, so that it also runs where only the parent finds it.
The arguments are the file and the largest permitted size of its content in bytes.
"""

from __future__ import annotations

import math
import pickle
import sys
import warnings
from typing import Any

import numpy as np
from scipy.io.matlab import loadmat, whosmat
from scipy.sparse import issparse

#: MATLAB's numeric classes -> bytes per number.
_BYTES = {"double": 8, "single": 4, "int64": 8, "uint64": 8, "int32": 4, "uint32": 4}


def content(value: Any, largest: int) -> Any:
    """Return what a value of a .mat file contains: an array of numbers or texts, name -> content
    for a structure, or None for other kinds and for a structure without arrays.

    A sparse matrix is returned as a full matrix.

    value: value as SciPy reads it, or name -> value
    largest: largest permitted size of a full matrix made from a sparse one, bytes

    Raises ValueError if a sparse matrix exceeds this size.
    """
    if isinstance(value, dict):
        entries = {name: content(entry, largest) for name, entry in value.items()}
        return {name: entry for name, entry in entries.items() if entry is not None} or None
    if issparse(value):
        rows, columns = value.shape
        if 8 * rows * columns > largest:
            raise ValueError(f"a sparse {rows} x {columns} matrix exceeds the limit")
        return value.toarray()
    if not isinstance(value, np.ndarray):
        return None
    if value.dtype.names and value.size == 1:  # a structure
        return content({name: value[name].item() for name in value.dtype.names}, largest)
    if value.dtype.kind == "O":  # a cell array
        return _texts(value)
    return value if value.dtype.kind in "iufcbU" else None


def _texts(cells: np.ndarray) -> np.ndarray | None:
    """Return the texts of a cell array, or None unless all its cells are texts."""
    texts = ["".join(cell.ravel()) for cell in cells.ravel() if _is_text(cell)]
    return np.array(texts) if texts and len(texts) == cells.size else None


def _is_text(cell: Any) -> bool:
    return isinstance(cell, np.ndarray) and (cell.dtype.kind == "U" or cell.size == 0)


def _refuse_larger(size: int, largest: int) -> None:
    """Raise ValueError if a size exceeds the largest permitted one, both in bytes."""
    if size > largest:
        raise ValueError(f"the file unpacks to more than {largest >> 20} MiB")


def main(path: str, largest: int) -> None:
    """Read a .mat file and write its content to standard output, pickled.

    Raises ValueError if the content needs more than `largest` bytes.
    """
    warnings.simplefilter("ignore")
    declared = [_BYTES.get(kind, 0) * math.prod(shape) for _, shape, kind in whosmat(path)]
    _refuse_larger(sum(declared), largest)  # before any number is read
    variables = {
        name: value
        for name, value in loadmat(path, appendmat=False).items()
        if not name.startswith("__")
    }
    pickled = pickle.dumps(content(variables, largest) or {})
    _refuse_larger(len(pickled), largest)
    sys.stdout.buffer.write(pickled)


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]))
    except NotImplementedError:
        sys.exit("MATLAB 7.3 files cannot be read; save with the option -v7")
    except Exception as error:  # a damaged file makes SciPy raise nearly anything
        sys.exit(f"{error}" or type(error).__name__)
