"""Child process of `mat_file` that writes the entries of a .mat file to standard output, as .npz.

A damaged file can crash or hang the process in which SciPy reads it. The arguments are the file and
the largest permitted size of its content in bytes. In the output, the arrays are named "0", "1" and
so on. The array "paths" is a JSON list. For each array it contains the list of the names that lead
through the structures to the array.
"""

from __future__ import annotations

import io
import json
import math
import sys
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.io.matlab import loadmat, whosmat
from scipy.sparse import issparse

#: MATLAB's numeric classes -> bytes per number.
_BYTES = {"double": 8, "single": 4, "int64": 8, "uint64": 8, "int32": 4, "uint32": 4}


def leaves(
    value: Any, path: tuple[str, ...], largest: int
) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Yield (names, array) for each array of numbers or text in a .mat file.

    The names are those of the structures that contain the array, from the outermost, then the name
    of the array. Values of other kinds are omitted. A sparse matrix is returned as a full matrix.

    value: content of the file, or of a structure in it
    path: names that lead to the value
    largest: largest permitted size of a full matrix made from a sparse one, bytes

    Raises ValueError if a sparse matrix exceeds this size.
    """
    if isinstance(value, dict):
        for name, each in value.items():
            yield from leaves(each, (*path, name), largest)
    elif issparse(value):
        if 8 * value.shape[0] * value.shape[1] > largest:
            raise ValueError(
                f"a sparse {value.shape[0]} x {value.shape[1]} matrix exceeds the limit"
            )
        yield path, value.toarray()
    elif isinstance(value, np.ndarray) and value.dtype.names and value.size == 1:
        yield from leaves({name: value[name].item() for name in value.dtype.names}, path, largest)
    elif isinstance(value, np.ndarray) and value.dtype.kind == "O":
        texts = ["".join(each.ravel()) if _is_text(each) else None for each in value.ravel()]
        if texts and None not in texts:
            yield path, np.array(texts)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufcbU":
        yield path, value


def _is_text(cell: Any) -> bool:
    return isinstance(cell, np.ndarray) and (cell.dtype.kind == "U" or cell.size == 0)


def _refuse_larger(size: int, largest: int) -> None:
    """Raise ValueError if a size exceeds the largest permitted one, both in bytes."""
    if size > largest:
        raise ValueError(f"the file unpacks to more than {largest >> 20} MiB")


def main(path: str, largest: int) -> None:
    """Read a .mat file and write its entries to standard output, as .npz.

    Raises ValueError if the entries need more than `largest` bytes.
    """
    warnings.simplefilter("ignore")
    declared = [_BYTES.get(kind, 0) * math.prod(shape) for _, shape, kind in whosmat(path)]
    _refuse_larger(sum(declared), largest)  # before any number is read
    content = {
        name: value
        for name, value in loadmat(path, appendmat=False).items()
        if not name.startswith("__")
    }
    found = list(leaves(content, (), largest))
    _refuse_larger(sum(array.nbytes for _, array in found), largest)
    stream = io.BytesIO()
    arrays: Any = {str(place): array for place, (_, array) in enumerate(found)}
    np.savez(stream, allow_pickle=False, paths=json.dumps([names for names, _ in found]), **arrays)
    sys.stdout.buffer.write(stream.getbuffer())


if __name__ == "__main__":
    try:
        main(sys.argv[1], int(sys.argv[2]))
    except NotImplementedError:
        sys.exit("MATLAB 7.3 files cannot be read; save with the option -v7")
    except Exception as error:  # a damaged file makes SciPy raise nearly anything
        sys.exit(f"{error}" or type(error).__name__)
