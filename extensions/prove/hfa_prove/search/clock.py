"""Processor time of a search and of its steps."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from hfa_support.progress import Progress


class OutOfTimeError(Exception):
    """Raised if a proof or fit exceeds its processor time."""

    def __init__(self, step: str, done: float) -> None:
        """Compose the message of the error.

        step: description of the last step, or ""
        done: share of the cube that is decided, 0 in a fit
        """
        after = f" after {step}" if step else ""
        undecided = f", {1.0 - done:.2g} of the cube undecided" if done > 0.0 else ""
        super().__init__(f"the time limit was reached{after}{undecided}")


class Clock:
    """Progress function of a search, which ends each step that exceeds its processor time.

    seconds: limit of the processor time of the search, s
    progress: called with the current step, or None. A KeyboardInterrupt from it ends the search.
    """

    def __init__(self, seconds: float, progress: Progress | None = None) -> None:
        self._begin = time.process_time()
        self._deadline = self._begin + seconds
        self._progress = progress

    @property
    def used(self) -> float:
        """Processor time since the beginning of the search, s."""
        return time.process_time() - self._begin

    @property
    def left(self) -> float:
        """Processor time left for the present step, s."""
        return self._deadline - time.process_time()

    @contextmanager
    def step(self, share: float) -> Iterator[None]:
        """Limit the steps in the `with` block to a share of the time that is left."""
        whole = self._deadline
        self._deadline = time.process_time() + share * self.left
        try:
            yield
        finally:
            self._deadline = whole

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Report progress.

        Raises OutOfTimeError if no time is left for the present step. Raises KeyboardInterrupt
        after Ctrl-C.
        """
        if self.left < 0.0:
            raise OutOfTimeError(what, done / total)
        if self._progress is not None:
            self._progress(done, total, what)
