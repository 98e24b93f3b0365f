"""Standard error while a command works: notes, and how far it is."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable

from hfa_support.errors import on_one_line
from hfa_support.streams import say_aside


def say_notes(warnings: Iterable[str]) -> None:
    """What a user should know before trusting a result, on standard error, a line each."""
    for warning in warnings:
        say_aside(f"hfa: note: {on_one_line(warning)}")


#: Seconds: of work from which its length is estimated, and from which it is announced.
_TRIAL, _LONG = 3.0, 300.0


class ProgressLine:
    """A `Progress` in one line of standard error, only when that is a terminal; gone when all is done."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._first: tuple[float, float] | None = None
        self._announced = False
        self._shown = sys.stderr is not None and sys.stderr.isatty()
        self._last = ""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Show the percentage of `done` in `total`, and the current step."""
        self._announce(done, total)
        line = f"\r\033[K{self._name}: {int(100 * done / total):3d} %" + (f"  {what}" if what else "")
        if self._shown and line != self._last:
            self._last = line
            say_aside(line, end="\r\033[K" if done >= total else "")

    def _announce(self, done: float, total: float) -> None:
        """Say once, terminal or not, what will take long: by the pace of the first `_TRIAL` seconds."""
        now = time.monotonic()
        if self._first is None or done < self._first[1]:  # the first part, or the next of several
            self._first = now, done
        began, before = self._first
        if self._announced or now - began < _TRIAL or done <= before:
            return
        self._announced = True
        left = (now - began) * (total - done) / (done - before)
        if left > _LONG:
            say_notes([f"{self._name}: about {left / 60:.3g} minutes more; Ctrl-C ends it"])
