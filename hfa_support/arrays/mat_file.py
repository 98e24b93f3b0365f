"""Reading of arrays and structures from .mat files."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.files import LARGEST, regular_file

#: Time limit, s; reading the largest .mat file takes a few seconds.
_LONGEST = 60.0
_CHILD = Path(__file__).with_name("_loadmat.py")


def structures(path: Path) -> dict[str, Any]:
    """Return name -> array for the content of a .mat file. A structure is a nested mapping.

    A damaged file may crash or hang SciPy. The file is therefore read in a child process.

    Raises ValueError if the file cannot be read, or not within `_LONGEST` seconds.
    """
    command = [sys.executable, "-P", str(_CHILD), str(regular_file(path).absolute()), str(LARGEST)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"reading takes longer than {_LONGEST:g} s; save the file as .npz"
        ) from error
    if done.returncode:
        message = ""
        if done.returncode == 1:
            message = done.stderr.decode("utf-8", "replace").strip()
        raise ValueError(message or "the file is damaged: SciPy crashes on it")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
        return _nested(arrays)


def _nested(arrays: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Return name -> array for the output of the child process. A structure is a nested mapping."""
    entries: dict[str, Any] = {}
    for number, (*outer, name) in enumerate(json.loads(str(arrays["paths"]))):
        inside = entries
        for structure in outer:
            inside = inside.setdefault(structure, {})
        inside[name] = arrays[str(number)]
    return entries
