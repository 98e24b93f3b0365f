"""Files that studies store for the page, with the linear models on which they are based."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hfa_support.errors import BadInputError, file_faults
from hfa_support.files import read_json

#: (dihedral angle in deg, A, B) of linear models.
Models = list[tuple[float, np.ndarray, np.ndarray]]
Content = TypeVar("Content")
#: Relative and absolute tolerance for equal entries of linear models: their trims balance to 1e-10
#: on every machine.
_SAME = 1e-9


def read_study(
    path: str, name: str, schema: str, stored: str, read: Callable[[Path, Any], Content]
) -> Content:
    """Return the content of a file with stored results.

    path: the file, or the folder that contains the file `name`
    schema: schema of the file
    stored: folder of the repository that has the file, for messages
    read: function from the file and its data to the content

    Raises BadInputError if the file cannot be read, has another schema or lacks an entry.
    """
    file = Path(path)
    if file.is_dir():
        file = file / name
    with file_faults(file):
        data = read_json(file)
    try:
        if data["schema"] != schema:
            raise ValueError(data["schema"])
        return read(file, data)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise BadInputError(f"{file} is damaged ({error!r}); take the file of {stored}") from error


def models_in(stored: Sequence[Mapping[str, Any]]) -> Models:
    """Return the linear models that a file contains."""
    return [
        (float(model["dihedral_deg"]), np.array(model["A"]), np.array(model["B"]))
        for model in stored
    ]


def are_same_models(models: Models, A_and_B: Mapping[float, tuple[np.ndarray, np.ndarray]]) -> bool:
    """Return whether models equal (A, B) at all common angles, of which there must be one at least.

    A_and_B: dihedral angle, deg -> (A, B)
    """
    shared = [model for model in models if model[0] in A_and_B]
    return bool(shared) and all(
        stored.shape == other.shape and np.allclose(stored, other, rtol=_SAME, atol=_SAME)
        for degrees, *pair in shared
        for stored, other in zip(pair, A_and_B[degrees], strict=True)
    )
