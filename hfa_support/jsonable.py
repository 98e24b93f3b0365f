"""Conversion of Python and NumPy values to JSON."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np


def jsonable(value: Any) -> Any:
    """Return a value as objects that `json` can write.

    Mappings, lists, tuples, arrays, texts and numbers are converted. Numbers that are not finite
    become None.
    """
    if isinstance(value, (float, np.floating)):  # tested first: most values are floats
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
    """Return a finite number as a float.

    inf and nan become None. JSON does not support these values.
    """
    return float(value) if math.isfinite(value) else None


def json_text(value: Any) -> str:
    """Return a value as indented JSON text, with each innermost list and object on one line."""
    text = json.dumps(jsonable(value), indent=1, allow_nan=False)
    return (
        re.sub(r"[\[{][^][{}]*[]}]", lambda innermost: re.sub(r"\n *", " ", innermost[0]), text)
        + "\n"
    )
