"""Standard output and error, whose reader may leave before the end (`hfa ... | head`): that changes no exit code."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from typing import TextIO


def say(text: str) -> None:
    """Print the text now, so that a disk that is full is reported by who prints; to nobody once the reader has left."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        drop(sys.stdout)


def say_aside(text: str, end: str = "\n") -> None:
    """Print the text on standard error; nowhere when that is closed or cannot be written."""
    if sys.stderr is None:
        return
    try:
        print(text, end=end, file=sys.stderr, flush=True)
    except OSError:
        drop(sys.stderr)


def drop(stream: TextIO) -> None:
    """Discard the buffered text of a stream, so that nothing fails when the process ends."""
    with contextlib.suppress(AttributeError, io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
