"""CasADi Functions bound to memory of ours, which each thread has for itself: arguments are written
in place, results read in place."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache, wraps
from typing import Any, TypeVar

import casadi as ca
import numpy as np


class BoundFunction:
    """Calls a dense CasADi Function without converting anything, about a microsecond of overhead a
    call.

    inputs, results: one flat array an argument and a result (columns of a matrix one after the
    other), owned here and overwritten by each call. Not for two threads at once."""

    def __init__(self, function: ca.Function) -> None:
        self.inputs = tuple(np.zeros(function.numel_in(i)) for i in range(function.n_in()))
        self.results = tuple(np.zeros(function.numel_out(i)) for i in range(function.n_out()))
        if function.nnz_in() + function.nnz_out() != sum(
            array.size for array in (*self.inputs, *self.results)
        ):
            raise ValueError(
                f"{function.name()}: arguments and results must be dense to be bound to memory"
            )
        buffer: Any
        buffer, self._evaluate = function.buffer()
        for index, array in enumerate(self.inputs):
            buffer.set_arg(index, array.data)
        for index, array in enumerate(self.results):
            buffer.set_res(index, array.data)
        self._buffer = buffer  # keeps the memory that the evaluation points to

    def __call__(self) -> None:
        """Evaluate: `results` follow from `inputs`."""
        self._evaluate()


Made = TypeVar("Made")

#: Expressions are built and compiled by one thread at a time.
_MAKING = threading.RLock()


def cached_per_thread(maxsize: int | None) -> Callable[[Callable[..., Made]], Callable[..., Made]]:
    """`functools.lru_cache` with one cache a thread: for a `BoundFunction`, whose memory each call
    overwrites.

    CasADi lets other Python threads run while it evaluates, and a worker of a cluster has several
    threads by default."""

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
