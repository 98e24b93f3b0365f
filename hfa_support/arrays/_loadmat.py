"""Child process of `mat_file` that writes the content of a .mat file to standard output, pickled.

SciPy 1.17 crashes on 36 of 6,000 files of which up to eight bytes were changed, and hangs on one.
This program imports nothing of the project, so that it also runs where only the parent finds it.
The arguments are the file and the largest permitted size of its content in bytes.
"""

from __future__ import annotations

import pickle
import sys
import warnings
from contextlib import suppress
from typing import Any

import numpy as np
from scipy.io.matlab import loadmat
from scipy.sparse import issparse

#: Largest memory of this process, bytes, where the system can limit it.
_MEMORY = 2**32


def content(value: Any) -> Any:
    """Return what a value of a .mat file contains: an array of numbers or texts, name -> content
    for a structure, a list of several, or None for other kinds and for one without arrays.

    A sparse matrix is returned as a full matrix.

    value: value as SciPy reads it, or name -> value
    """
    if isinstance(value, dict):
        entries = {name: content(entry) for name, entry in value.items()}
        return {name: entry for name, entry in entries.items() if entry is not None} or None
    if issparse(value):
        return value.toarray()
    if not isinstance(value, np.ndarray):
        return None
    if value.dtype.names:  # a structure, or an array of structures
        rows = [content(dict(zip(value.dtype.names, row, strict=True))) for row in value.ravel()]
        return rows[0] if len(rows) == 1 else rows or None
    if value.dtype.kind == "O":  # a cell array
        return _texts(value)
    return value if value.dtype.kind in "iufcbU" else None


def _texts(cells: np.ndarray) -> np.ndarray | None:
    """Return the texts of a cell array, or None unless all its cells are texts."""
    texts = ["".join(cell.ravel()) for cell in cells.ravel() if _is_text(cell)]
    return np.array(texts) if texts and len(texts) == cells.size else None


def _is_text(cell: Any) -> bool:
    """Return whether a cell is a text; SciPy reads an empty one as an empty array of any type."""
    return isinstance(cell, np.ndarray) and (cell.dtype.kind == "U" or cell.size == 0)


def main(path: str, largest: int) -> None:
    """Read a .mat file and write its content to standard output, pickled.

    Raises MemoryError if the content needs more than `largest` bytes.
    """
    with suppress(ImportError, ValueError):  # on Windows; a limit that is smaller already
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    warnings.simplefilter("ignore")
    variables = {
        name: value
        for name, value in loadmat(path, appendmat=False).items()
        if not name.startswith("__")
    }
    pickled = pickle.dumps(content(variables) or {})
    if len(pickled) > largest:
        raise MemoryError
    sys.stdout.buffer.write(pickled)


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]))
    except MemoryError:
        sys.exit(f"the file unpacks to more than {int(sys.argv[2]) >> 20} MiB")
    except NotImplementedError:
        sys.exit("MATLAB 7.3 files cannot be read; save with the option -v7")
    except Exception as error:  # a damaged file makes SciPy raise nearly anything
        sys.exit(f"{error}" or type(error).__name__)
