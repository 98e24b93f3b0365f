"""How long work says how far it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

Item = TypeVar("Item")
#: Told how many of how many are done.
Progress = Callable[[int, int], None]
#: Told of what how many of how many are done.
NamedProgress = Callable[[str, int, int], None]
#: Told which fraction is done, and what is at work.
SaidProgress = Callable[[float, str], None]


def told(items: Sequence[Item], progress: Progress | None) -> Iterator[Item]:
    """The items one after the other; `progress` is told after each."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, len(items))
