"""Reading of arrays and structures from .mat files."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

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
        child = subprocess.run(command, capture_output=True, timeout=_LONGEST)
    except subprocess.TimeoutExpired as error:
        raise ValueError(
            f"reading takes longer than {_LONGEST:g} s; save the file as .npz"
        ) from error
    if child.returncode:
        message = ""
        if child.returncode == 1:
            message = child.stderr.decode("utf-8", "replace").strip()
        raise ValueError(message or "the file is damaged: SciPy crashes on it")
    content: dict[str, Any] = pickle.loads(child.stdout)  # of `_loadmat.py`, not of the file
    return content
