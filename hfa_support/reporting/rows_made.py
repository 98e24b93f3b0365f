"""Rows of long tables, computed when they are accessed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


class RowsMade(Sequence[tuple[Any, ...]]):
    """Sequence of the rows of a table, each computed when it is accessed."""

    def __init__(self, count: int, row: Callable[[int], tuple[Any, ...]]) -> None:
        self._count = count
        self._row = row

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if not 0 <= index < self._count:
            raise IndexError(index)
        return self._row(index)
