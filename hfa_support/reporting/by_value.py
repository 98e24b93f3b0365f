"""Comparison by value of dataclasses that contain arrays."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np


class ByValue:
    """Base of a dataclass (`eq=False`) that compares fields by value.

    Arrays are compared entry by entry; nan equals nan. The comparison of `dataclass` itself would
    raise, because it takes the truth of an array.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(
            _same(getattr(self, field.name), getattr(other, field.name))
            for field in fields(self)  # type: ignore[arg-type]
            if field.compare
        )


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(
            one, other, equal_nan=one.dtype.kind in "fc" and other.dtype.kind in "fc"
        )
    return bool(one == other)
