"""Finished parts of a long job, in files that are identified by the settings of their numbers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hfa_support.files import read_json, write_text
from hfa_support.jsonable import json_text, jsonable
from hfa_support.version import VERSION


def stamp(decides: Mapping[str, Any]) -> dict[str, str]:
    """Return the version that makes a result, and a hash of all other settings of its numbers.

    The settings are JSON values.
    """
    return {"toolchain": VERSION, "identity": _digest(jsonable(decides))}


def stamped(content: Mapping[str, Any], decides: Mapping[str, Any]) -> dict[str, Any]:
    """Return the stored content of a finished part, as JSON values: content, stamp and digest."""
    whole: dict[str, Any] = jsonable({**content, **stamp(decides)})
    return whole | {"digest": _digest(whole)}


def finished(path: Path, decides: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the JSON object in a file, or None unless it has the present stamp and is
    unchanged.
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
    """Return rows about aircraft, in the order of the names: those stored in a file, and new ones.

    Each new row is stored at once. Stored rows of other settings or another version are discarded.

    names: names of all aircraft
    asked: aircraft of the new rows, or None for those without a stored row
    decides: settings of all rows (JSON values), stored with them
    row_of: name -> row, with the name as "aircraft"
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
    """Return a digest of the content without the digest, the date and the command.

    It is equal for equal results.
    """
    told = {name: value for name, value in content.items() if name not in ("digest", "provenance")}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
