"""Finished parts of a long job, in files that are known again by what decided their numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hfa_model.support.input_files import read_json
from hfa_model.support.jsonable import jsonable
from hfa_model.support.version import toolchain_version


def stamp(decides: Mapping[str, Any]) -> dict[str, str]:
    """The version that makes a result, and a hash of everything else that decides its numbers (JSON values)."""
    text = json.dumps(jsonable(decides), sort_keys=True)
    return {"toolchain": toolchain_version(), "identity": hashlib.sha256(text.encode()).hexdigest()}


def finished(path: Path, decides: Mapping[str, Any]) -> dict[str, Any] | None:
    """The JSON object in a file if it bears the stamp of today; None for any other file, or none."""
    try:
        data = read_json(path)
        known = all(data[name] == value for name, value in stamp(decides).items())
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return data if known else None
