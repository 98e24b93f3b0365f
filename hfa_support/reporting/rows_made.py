"""Rows of long tables, made one by one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any


class RowsMade(Sequence[tuple[Any, ...]]):
    """Rows 0 ... count - 1, each made when it is read: a million of them need no memory."""

    def __init__(self, count: int, row: Callable[[int], tuple[Any, ...]]) -> None:
        self._count = count
        self._row = row

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: Any) -> Any:
        if not 0 <= index < self._count:
            raise IndexError(index)
        return self._row(index)
