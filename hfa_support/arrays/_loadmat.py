"""Child process of `mat_file` that writes the content of a .mat file to standard output, pickled.

SciPy 1.17 crashes on 36 of 6,000 files of which up to eight bytes were changed, and hangs on one.
This program imports nothing of the project, so that it also runs where only the parent finds it.
The arguments are the file and the largest permitted size of its content in bytes.
"""

from __future__ import annotations

import pickle
import sys
import warnings
import zlib
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.io.matlab import loadmat
from scipy.sparse import issparse

#: Type of a compressed element of a .mat file, and bytes of the header before the first element.
_COMPRESSED, _HEADER_SIZE = 15, 128
#: Byte order in the header -> that of Python.
_BYTE_ORDERS: dict[bytes, Literal["little", "big"]] = {b"IM": "little", b"MI": "big"}
_PIECE_SIZE = 2**20


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


def _full_size(value: Any) -> int:
    """Return the size of the arrays in a value as SciPy reads it, bytes; sparse matrices count as
    full ones, which `content` makes of them.
    """
    if issparse(value):
        return int(np.prod(value.shape, dtype=object)) * int(value.dtype.itemsize)
    if not isinstance(value, np.ndarray):
        return 0
    if value.dtype.hasobject:
        entries = value.ravel().tolist()  # of a structure, tuples of its fields
        fields = [field for entry in entries for field in entry] if value.dtype.names else entries
        return sum(map(_full_size, fields))
    return value.nbytes


def _unpacked_size(file: bytes, largest: int) -> int:
    """Return the unpacked size of all compressed elements of a .mat file, bytes; counting ends
    above the largest permitted size. A file of MATLAB 4, which has no byte order, has no such
    elements.
    """
    order = _BYTE_ORDERS.get(file[_HEADER_SIZE - 2 : _HEADER_SIZE])
    size, place = 0, _HEADER_SIZE
    while order and place + 8 <= len(file) and size <= largest:
        kind, length = (int.from_bytes(file[at : at + 4], order) for at in (place, place + 4))
        place += 8
        if kind == _COMPRESSED:
            unpacker, rest = zlib.decompressobj(), file[place : place + length]
            while rest and not unpacker.eof and size <= largest:
                size += len(unpacker.decompress(rest, _PIECE_SIZE))
                rest = unpacker.unconsumed_tail
        place += length
    return size


def _refuse_larger(size: int, largest: int) -> None:
    """Raise ValueError if a size exceeds the largest permitted one, both in bytes."""
    if size > largest:
        raise ValueError(f"the file unpacks to more than {largest >> 20} MiB")


def main(path: str, largest: int) -> None:
    """Read a .mat file and write its content to standard output, pickled.

    Raises ValueError if the content needs more than `largest` bytes.
    """
    warnings.simplefilter("ignore")
    _refuse_larger(_unpacked_size(Path(path).read_bytes(), largest), largest)
    variables = {
        name: value
        for name, value in loadmat(path, appendmat=False).items()
        if not name.startswith("__")
    }
    _refuse_larger(sum(map(_full_size, variables.values())), largest)
    pickled = pickle.dumps(content(variables) or {})
    _refuse_larger(len(pickled), largest)
    sys.stdout.buffer.write(pickled)


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]))
    except NotImplementedError:
        sys.exit("MATLAB 7.3 files cannot be read; save with the option -v7")
    except Exception as error:  # a damaged file makes SciPy raise nearly anything
        sys.exit(f"{error}" or type(error).__name__)
