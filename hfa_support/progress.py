"""How long work reports how far it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Progress(Protocol):
    """A callback of long work."""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """`done` of `total` parts are done; `what` is at work."""


def told(items: Sequence[Item], progress: Progress | None) -> Iterator[Item]:
    """The items one after the other; `progress` is called after each."""
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, len(items))
