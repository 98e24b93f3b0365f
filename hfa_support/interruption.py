"""Interruption of long searches by Ctrl-C.

The result found so far is kept.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Yield an event that is set by the first Ctrl-C.

    A second Ctrl-C has its usual effect. The event is never set outside the main thread, or if
    SIGINT is ignored. An exception could not replace the event, because CasADi discards exceptions
    that are raised during IPOPT.
    """
    interrupted = threading.Event()
    before = signal.getsignal(signal.SIGINT)
    in_main_thread = threading.current_thread() is threading.main_thread()
    if before in (None, signal.SIG_IGN) or not in_main_thread:
        yield interrupted
        return

    def on_interrupt(number: int, frame: object) -> None:
        signal.signal(signal.SIGINT, before)
        interrupted.set()

    signal.signal(signal.SIGINT, on_interrupt)
    try:
        yield interrupted
    finally:
        signal.signal(signal.SIGINT, before)
