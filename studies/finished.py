"""Files of finished parts of a long computation, each valid for one set of settings."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hfa_support.files import read_json, write_text
from hfa_support.reporting.data_files import json_text, jsonable
from hfa_support.version import VERSION


def stamp(decides: Mapping[str, Any]) -> dict[str, str]:
    """Return the version of this project and a hash of the settings that determine a result.

    decides: the settings, JSON values
    """
    return {"toolchain": VERSION, "identity": _digest(jsonable(decides))}


def stamped(content: Mapping[str, Any], decides: Mapping[str, Any]) -> dict[str, Any]:
    """Return a finished part of a computation with its stamp and a digest, as JSON values.

    content: results of the finished part
    decides: settings that determine the content
    """
    whole: dict[str, Any] = jsonable({**content, **stamp(decides)})
    return whole | {"digest": _digest(whole)}


def finished(path: Path, decides: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the JSON object in a file, or None if the file is not valid.

    A file is valid if its version and settings equal the current ones and its digest is correct.

    decides: the current settings, JSON values
    """
    try:
        data = read_json(path)
        known = data["digest"] == _digest(data) and stamp(decides).items() <= data.items()
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None
    return data if known else None


def row_by_row(
    path: Path,
    names: Iterable[str],
    asked: Sequence[str] | None,
    decides: Mapping[str, Any],
    row_of: Callable[[str], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Return one row for each aircraft, in the order of `names`. Rows stored in a file are reused.

    Each new row is stored immediately. Rows stored with other settings or by another version are
    discarded.

    names: names of all aircraft
    asked: aircraft whose rows are computed again, or None to compute only the missing rows
    decides: settings that determine all rows, JSON values
    row_of: function name -> row, which contains the name under "aircraft"
    """
    stored = finished(path, decides)
    done = {row["aircraft"]: row for row in stored["aircraft"]} if stored else {}
    path.parent.mkdir(parents=True, exist_ok=True)
    for name in asked or [each for each in names if each not in done]:
        done[name] = row_of(name)
        in_order = [done[each] for each in names if each in done]
        write_text(path, json_text(stamped({**decides, "aircraft": in_order}, decides)))
    return [done[each] for each in names if each in done]


def _digest(content: Mapping[str, Any]) -> str:
    """Return a SHA-256 digest of a finished part. Its stored digest and provenance are left out."""
    told = {name: value for name, value in content.items() if name not in ("digest", "provenance")}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
