"""Helpers that write plants and critics to files, for tests of commands."""

import json
from pathlib import Path

import numpy as np
from scipy.io import savemat

AT_15 = ("--dihedral", "15")
#: A plant with two states and one input.
SMALL = {
    "A": [[-0.2, 1.0], [-2.0, -0.3]],
    "B": [[0.0], [1.0]],
    "Q": [[2.0, 0.0], [0.0, 1.0]],
    "R": [[0.5]],
    "E": [[1.0], [0.5]],
    "delta": 3.0,
}


def stored(path, **content):
    """Write arrays to a .json, .npz or .mat file and return its path as text."""
    path = Path(path)
    if path.suffix == ".json":
        path.write_text(json.dumps(content, default=np.ndarray.tolist), "utf-8")
    elif path.suffix == ".npz":
        np.savez(path, **content)
    else:
        savemat(path, content)
    return str(path)


def small(path, **changes):
    """Write the plant `SMALL`, with changed entries, and return the path of the file.

    changes: entries that replace those of `SMALL`; None omits an entry
    """
    content = {key: value for key, value in (SMALL | changes).items() if value is not None}
    return stored(path, **content)
