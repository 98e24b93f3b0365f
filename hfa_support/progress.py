"""Progress of long work, and its interruption."""

from __future__ import annotations

import contextlib
import io
import os
import signal
import sys
import textwrap
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Protocol, TextIO, TypeVar

from hfa_support.errors import on_one_line

Item = TypeVar("Item")
#: Largest number of columns of a message on a terminal.
_COLUMNS = 80


class Progress(Protocol):
    """Callback that reports the progress of a long computation."""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Report that `done` of `total` parts are complete.

        what: name of the current step
        """


def with_progress(items: Sequence[Item], progress: Progress | None) -> Iterator[Item]:
    """Yield the items of a sequence, and report the progress after each item is processed.

    progress: callback, or None
    """
    for done, item in enumerate(items, start=1):
        yield item
        if progress is not None:
            progress(done, len(items))


def print_notes(warnings: Iterable[str]) -> None:
    """Print each note as one line on standard error, prefixed by "hfa: note: "."""
    for warning in warnings:
        print_to_stderr(f"hfa: note: {on_one_line(warning)}")


def print_to_stderr(text: str, end: str = "\n") -> None:
    """Print a text on standard error. On a terminal, the text replaces an unfinished progress line,
    and a text of whole lines is wrapped at `_COLUMNS`.

    Nothing is printed if standard error is closed or cannot be written.

    end: characters printed after the text
    """
    if sys.stderr is None:
        return
    try:
        start = ""
        if sys.stderr.isatty():
            start = "\r\033[K"
            if end == "\n":
                text = textwrap.fill(text, _COLUMNS, break_long_words=False, break_on_hyphens=False)
        print(start + text, end=end, file=sys.stderr, flush=True)
    except OSError:
        drop(sys.stderr)


def drop(stream: TextIO) -> None:
    """Redirect a stream that cannot be written to the null device, so that Python's flush at the
    exit cannot fail.
    """
    with contextlib.suppress(AttributeError, io.UnsupportedOperation):
        descriptor = stream.fileno()
        os.close(descriptor)  # frees the descriptor for the null device
        os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)


@contextmanager
def interruption() -> Iterator[threading.Event]:
    """Yield an event that is set by the first Ctrl-C.

    A second Ctrl-C has its usual effect. The event is never set outside the main thread, or if
    SIGINT is ignored. It is no exception, because CasADi discards those raised during IPOPT.
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
