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

    Results whose calls overwrite their memory, such as a `BoundFunction`, need a separate cache,
    because CasADi releases the interpreter lock while it evaluates.
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
