"""What each thread has for itself: a cache whose values two threads may not use at once."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

Made = TypeVar("Made")

#: Expressions are built and compiled by one thread at a time.
_MAKING = threading.RLock()


def cached_per_thread(maxsize: int | None) -> Callable[[Callable[..., Made]], Callable[..., Made]]:
    """`functools.lru_cache` with one cache a thread: for a `BoundFunction`, whose memory each call overwrites.

    CasADi lets other Python threads run while it evaluates, and a worker of a cluster has several threads by default.
    """

    def decorate(make: Callable[..., Made]) -> Callable[..., Made]:
        own = threading.local()

        def make_alone(*key: Any) -> Made:
            with _MAKING:
                return make(*key)

        @wraps(make)
        def cached(*key: Any) -> Made:
            if not hasattr(own, "cache"):
                own.cache = lru_cache(maxsize)(make_alone)
            made: Made = own.cache(*key)
            return made

        return cached

    return decorate
