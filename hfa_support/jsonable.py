"""Values as JSON has them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def jsonable(value: Any) -> Any:
    """Mappings, lists, tuples, arrays, texts and numbers for `json`; a number that is not finite becomes None."""
    if isinstance(value, (float, np.floating)):  # most values are, and the other questions take longer
        return finite_or_none(value)
    if isinstance(value, (list, tuple)):
        return [jsonable(item) for item in value]
    if isinstance(value, Mapping):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        values = value.tolist()
        return values if value.dtype == float and np.isfinite(value).all() else jsonable(values)
    return value.item() if isinstance(value, np.generic) else value


def finite_or_none(value: float | np.floating[Any]) -> float | None:
    """JSON has no infinity: None for a number that is not finite."""
    return float(value) if math.isfinite(value) else None


def json_text(value: Any) -> str:
    """The value as indented JSON."""
    return json.dumps(jsonable(value), indent=2, allow_nan=False)


def records_text(value: Any) -> str:
    """JSON in which a table, a list of objects, has one row a line, and what holds no table is one line."""
    return _records_text(jsonable(value), "") + "\n"


def _records_text(value: Any, indent: str) -> str:
    if indent and not _holds_table(value):
        return json.dumps(value, allow_nan=False, ensure_ascii=False)
    if isinstance(value, dict):
        brackets, entries = "{}", [(f"{json.dumps(key, ensure_ascii=False)}: ", item) for key, item in value.items()]
    else:
        brackets, entries = "[]", [("", item) for item in value]
    inner = indent + " "
    lines = ",\n".join(f"{inner}{name}{_records_text(item, inner)}" for name, item in entries)
    return f"{brackets[0]}\n{lines}\n{indent}{brackets[1]}"


def _holds_table(value: Any) -> bool:
    if isinstance(value, dict):
        return any(map(_holds_table, value.values()))
    return isinstance(value, list) and any(isinstance(item, dict) or _holds_table(item) for item in value)
