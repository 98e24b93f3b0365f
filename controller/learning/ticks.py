"""Loop that runs a learner tick by tick, with history and progress."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hfa_support.progress import Progress

#: Largest number of stored rows of the history.
MOST_ROWS = 20_001
#: Number of progress reports in a run; there are more if ticks are slow.
REPORTS = 50
#: Longest time without a progress report, s.
SILENCE = 0.5


@dataclass(frozen=True, eq=False)
class Run:
    """Final state and history of a learner that has finished.

    memory: memory after the last tick
    history: name -> values at the recorded ticks, (number of recorded ticks, ...)
    """

    memory: Any
    history: dict[str, np.ndarray]


class Learner(Protocol):
    """Learner that is run tick by tick."""

    @property
    def ticks(self) -> int:
        """Number of ticks."""

    def start(self) -> Any:
        """Return the memory before the first tick, any object."""

    def advance(self, tick: int, memory: Any) -> Any:
        """Return the memory after tick number `tick` (0 .. ticks - 1), without side effects."""

    def observe(self, tick: int, memory: Any) -> Mapping[str, Any]:
        """Return one row of the history, the values after `tick` ticks (0 .. ticks).

        The row contains "time", s, and further values, with the same names in each row.
        """


def run(learner: Learner, *, progress: Progress | None = None) -> Run:
    """Run all ticks of a learner, and return its last memory and its history.

    The history has at most `MOST_ROWS` rows, evenly distributed over the ticks.

    progress: called with (fraction done, 1, text), or None
    """
    memory = learner.start()
    rows = [_row(learner, 0, memory)]
    row_every = math.ceil(learner.ticks / (MOST_ROWS - 1))
    report_every = max(1, learner.ticks // REPORTS)
    reported = time.monotonic()
    for tick in range(1, learner.ticks + 1):
        memory = learner.advance(tick - 1, memory)
        last = tick == learner.ticks
        if tick % row_every == 0 or last:
            rows.append(_row(learner, tick, memory))
        is_silent = time.monotonic() - reported > SILENCE
        if progress is not None and (tick % report_every == 0 or last or is_silent):
            progress(tick / learner.ticks, 1.0, f"t = {rows[-1]['time']:.3g} s")
            reported = time.monotonic()
    return Run(memory, {name: np.array([row[name] for row in rows]) for name in rows[0]})


def _row(learner: Learner, tick: int, memory: Any) -> Mapping[str, Any]:
    """Return the values that a learner reports after `tick` ticks, one row of the history.

    A number that overflows is inf, without a warning.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return learner.observe(tick, memory)
