"""Standard output, whose reader may leave before the end (`hfa ... | head`): that changes no exit code."""

from __future__ import annotations

import contextlib
import io
import os
import sys


def say(text: str) -> None:
    """Print the text now, so that a disk that is full is reported by who prints; to nobody once the reader has left."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        drop_output()


def drop_output() -> None:
    """Send what is still buffered for standard output nowhere, so that nothing fails when the process ends."""
    with contextlib.suppress(AttributeError, io.UnsupportedOperation):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
