"""Properties that are computed when they are first read."""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, TypeVar

T = TypeVar("T")


class cached_property(functools.cached_property[T]):
    """`functools.cached_property` without the lock of Python 3.11, one for all instances.

    Under that lock, a thread would wait for the precision of balls, and one that has this precision
    for the lock; a process that is forked meanwhile would find it locked for ever. Two threads may
    compute a property twice.
    """

    def __init__(self, func: Callable[[Any], T]) -> None:
        super().__init__(func)
        self.lock = nullcontext()
