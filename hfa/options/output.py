"""Standard output and error during a run: text, and the progress of a computation."""

from __future__ import annotations

import sys
import time

from hfa_support.progress import drop, print_notes, print_to_stderr


def print_flushed(text: str) -> None:
    """Print a text on standard output and flush the stream.

    A full disk therefore raises an OSError here. If the reader of the pipe has stopped, later
    output is discarded.
    """
    try:
        print(text, flush=True)
    except BrokenPipeError:
        drop(sys.stdout)


#: Seconds of work before the duration is estimated, and shortest duration that is announced.
_TRIAL = 3.0
_LONG = 60.0


class ProgressLine:
    """Display of the progress of a run, on one line of standard error that is erased at the end.

    The line is shown only on a terminal. A note on a long run is printed in any case.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._first: tuple[float, float] | None = None
        self._announced = False
        self._shown = sys.stderr is not None and sys.stderr.isatty()
        self._last = ""

    def __call__(self, done: float, total: float, what: str = "", /) -> None:
        """Show the progress as a percentage.

        done, total: amounts of work, in any unit
        what: current step, shown after the percentage
        """
        self._announce(done, total)
        line = f"{self._name}: {int(100 * done / total):3d} %"
        if what:
            line += f"  {what}"
        if self._shown and line != self._last:
            self._last = line
            print_to_stderr(line, end="\r\033[K" if done >= total else "")

    def _announce(self, done: float, total: float) -> None:
        """Print a note with the remaining time of a long run, at most once."""
        now = time.monotonic()
        is_next = self._first is not None and done < self._first[1]  # of several computations
        if self._first is None or is_next or not done:  # preparation until now
            self._first = now, done
        began, before = self._first
        if self._announced or now - began < _TRIAL or done <= before:
            return
        self._announced = True
        seconds = (now - began) * (total - done) / (done - before)
        if seconds > _LONG:
            print_notes([f"{self._name}: about {seconds / 60:.3g} minutes more; Ctrl-C ends it"])
