"""Files with one matrix each, .npy and .csv, named after the matrix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.arrays.csv_file import matrices_and_names, matrices_of_entries
from hfa_support.errors import BadInputError, file_faults
from hfa_support.files import regular_file

#: Names of the matrices of a plant, in files next to A.csv, and of a critic.
PLANT = ("A", "B", "E", "Q", "R", "N", "delta")
CRITIC = ("W", "P", "K", "weights")
#: Name of the matrix in a .npy file that is not named after one of these.
UNKNOWN = "the array"


def matrices(path: Path) -> dict[str, Any]:
    """Return the matrices read from a .npy or .csv file, which contains one matrix, by their names.

    - a file named A: the result also contains the other matrices of the plant in the same folder
    - a .csv file: the result also contains the names and units of states and inputs in the file
    - a .csv table of `hfa solve`: P and K
    - a .npy file that is not named after a matrix of a plant or critic: its matrix has the name
      `UNKNOWN`

    Raises BadInputError as `_matrix_files` does.
    """
    if path.suffix.lower() == ".csv":
        with file_faults(path):
            entries = matrices_of_entries(path)
        if entries is not None:
            return entries
        return matrices_and_names(_matrix_files(path))
    files = _matrix_files(path) if path.stem in (*PLANT, *CRITIC) else {UNKNOWN: path}
    arrays = {}
    for name, file in files.items():
        with file_faults(file):
            arrays[name] = np.load(regular_file(file), allow_pickle=False)
    return arrays


def _matrix_files(path: Path) -> dict[str, Path]:
    """Return matrix name -> path, of a file named A also of the other matrices of its plant.

    Raises BadInputError for a file that is named after no matrix of a plant or critic.
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
