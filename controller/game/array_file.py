"""Arrays by name in .json, .npz, .mat and .csv files, whatever is in them: arrays, or one line that says why not."""

from __future__ import annotations

import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from controller.game.csv_file import read_csv
from controller.game.mat_file import read_mat
from hfa_model.support.echo import shortened
from hfa_model.support.errors import BadInputError
from hfa_model.support.input_files import LARGEST, read_json, regular_file


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
            return {key: arrays[key] for key in arrays.files}


def _mat(path: str | Path) -> dict[str, Any]:
    return read_mat(regular_file(path).read_bytes())


_READERS: dict[str, Callable[[str | Path], dict[str, Any]]] = {
    ".json": _json,
    ".npz": _npz,
    ".mat": _mat,
    ".csv": read_csv,
}


def _first_line(error: Exception) -> str:
    lines = str(error).splitlines()
    return shortened(lines[0], 200) if lines else type(error).__name__
