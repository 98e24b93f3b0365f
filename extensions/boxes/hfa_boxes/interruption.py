"""Ctrl-C during long work: the result so far is reported."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from hfa_support.progress import Progress


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Yield an event that Ctrl-C sets in the main thread.

    A second Ctrl-C has the effect that it had before the block. No exception is raised, because
    CasADi drops one that arrives in IPOPT.
    """
    asked = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    in_main_thread = threading.current_thread() is threading.main_thread()
    if before in (None, signal.SIG_IGN) or not in_main_thread:
        yield asked
        return

    def ask(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, before)
        asked.set()

    signal.signal(signal.SIGINT, ask)
    try:
        yield asked
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def interruptible(progress: Progress) -> Iterator[Progress]:
    """Yield the progress of a search; after Ctrl-C its next call raises KeyboardInterrupt."""
    with interruption() as asked:

        def tell(done: float, total: float, what: str = "", /) -> None:
            if asked.is_set():
                raise KeyboardInterrupt
            progress(done, total, what)

        yield tell
