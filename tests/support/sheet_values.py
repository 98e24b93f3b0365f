"""Values of the rows of a sheet, from the data of its report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def values(data: Mapping[str, Any], *groups: str) -> dict[str, Any]:
    """Return name -> value of the rows in some groups, by default in all."""
    return {
        name: row["value"]
        for name, row in data["sheet"].items()
        if not groups or row["group"] in groups
    }
