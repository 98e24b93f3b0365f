"""Tables as the text of a TOML file."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any


def toml_text(tables: Mapping[str, Mapping[str, Any]]) -> str:
    """Return tables of texts, numbers, paths, lists and mappings as TOML, name -> entries."""
    lines = []
    for table, entries in tables.items():
        lines.append(f"[{table}]")
        lines += [_toml_entry(*entry) for entry in entries.items()]
    return "\n".join([*lines, ""])


def _toml_entry(name: str, value: Any) -> str:
    """Return "name = value", with the name in quotes where TOML requires them."""
    key = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else json.dumps(name)
    return f"{key} = {_toml_value(value)}"


def _toml_value(value: Any) -> str:
    """Return a value as TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(_toml_entry(*entry) for entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, float):  # in 15 digits: without the rounding errors of a conversion
        return repr(float(f"{value:.15g}"))
    return json.dumps(str(value) if isinstance(value, Path) else value)
