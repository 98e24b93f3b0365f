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
    return {"toolchain": toolchain_version(), "identity": _digest(jsonable(decides))}


def stamped(content: Mapping[str, Any], decides: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of a finished part, as JSON values: the content, the stamp of today, and a digest of all of it."""
    whole: dict[str, Any] = jsonable({**content, **stamp(decides)})
    return whole | {"digest": _digest(whole)}


def finished(path: Path, decides: Mapping[str, Any]) -> dict[str, Any] | None:
    """The JSON object in a file, if it bears the stamp of today and is as it was written; else None."""
    try:
        data = read_json(path)
        content = {name: value for name, value in data.items() if name != "digest"}
        known = data["digest"] == _digest(content) and stamp(decides).items() <= content.items()
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return data if known else None


def _digest(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
