"""NumPy archives that appear whole or not at all."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hfa_model.errors import BadInputError
from hfa_model.files import written_whole


def save_npz(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to a .npz file through a temporary file beside it and a rename.

    Raises BadInputError when the folder does not exist or cannot be written.
    """
    with written_whole(path) as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]


def load_npz(path: str | Path) -> dict[str, np.ndarray]:
    """Read every array of a .npz file. Raises BadInputError when it is missing or not such a file."""
    try:
        with np.load(path, allow_pickle=False) as data:
            return dict(data.items())
    except FileNotFoundError as error:
        raise BadInputError(f"no file {path}") from error
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError, TypeError) as error:
        raise BadInputError(f"{path} is not a readable .npz file") from error
