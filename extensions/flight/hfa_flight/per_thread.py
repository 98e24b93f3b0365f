"""A cache with separate entries for each thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

from hfa_support.native.bound import MAKING

Made = TypeVar("Made")


def cached_per_thread(maxsize: int | None) -> Callable[[Callable[..., Made]], Callable[..., Made]]:
    """Return a decorator like `functools.lru_cache` with one cache for each thread.

    Threads must not share results such as a `BoundFunction`, because each call overwrites the
    memory of the result.

    maxsize: number of results in each cache, or None for no limit
    """

    def decorate(make: Callable[..., Made]) -> Callable[..., Made]:
        own = threading.local()

        def make_alone(*key: Any) -> Made:
            with MAKING:
                return make(*key)

        @wraps(make)
        def cached(*key: Any) -> Made:
            if not hasattr(own, "cache"):
                own.cache = lru_cache(maxsize)(make_alone)
            made: Made = own.cache(*key)
            return made

        return cached

    return decorate
