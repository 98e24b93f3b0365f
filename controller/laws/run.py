"""Runs a law tick by tick, with history and progress."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hfa_support.progress import Progress

#: At most this many rows of history are kept of a run, evenly spread over its ticks.
MOST_ROWS = 20_001
#: Progress is reported this many times in a run.
REPORTS = 50


class Process(Protocol):
    """A learning law on one game and its data: a start, a pure step, and what to write down.

    memory: whatever the law carries from one tick to the next. Any object with these methods is a law.
    """

    @property
    def ticks(self) -> int:
        """Number of steps of a whole run."""

    def start(self) -> Any:
        """The memory before the first tick."""

    def advance(self, tick: int, memory: Any) -> Any:
        """The memory after tick number `tick` (0 .. ticks - 1)."""

    def observe(self, tick: int, memory: Any) -> Mapping[str, Any]:
        """The row of history after `tick` ticks (0 .. ticks): "time", s, and what else is to be kept, each time the
        same names; with "law_residual_norm", the residual that the law drives to zero, the progress shows it."""


@dataclass(frozen=True, eq=False)
class Run:
    """memory: at the last tick. history: rows by name, (rows, ...)."""

    memory: Any
    history: dict[str, np.ndarray]


def run(process: Process, *, progress: Progress | None = None) -> Run:
    """Run all ticks of a law."""
    memory = process.start()
    rows = [_row(process, 0, memory)]
    every = -(-process.ticks // (MOST_ROWS - 1))
    report_every = max(1, process.ticks // REPORTS)
    for tick in range(1, process.ticks + 1):
        memory = process.advance(tick - 1, memory)
        last = tick == process.ticks
        if tick % every == 0 or last:
            rows.append(_row(process, tick, memory))
        if progress is not None and (tick % report_every == 0 or last):
            progress(tick / process.ticks, 1.0, _line(rows[-1]))
    return Run(memory, {name: np.array([row[name] for row in rows]) for name in rows[0]})


def _row(process: Process, tick: int, memory: Any) -> Mapping[str, Any]:
    """A row of history; a residual that overflows is inf in it, and the law itself says when it cannot go on."""
    with np.errstate(over="ignore", invalid="ignore"):
        return process.observe(tick, memory)


def _line(row: Mapping[str, Any]) -> str:
    residual = f", residual of the law {row['law_residual_norm']:.3g}" if "law_residual_norm" in row else ""
    return f"t = {row['time']:.3g} s{residual}"
