"""Runs a law tick by tick, with history and progress."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hfa_support.progress import Progress

#: At most this many rows of history are kept of a run, evenly spread over its ticks.
MOST_ROWS = 20_001
#: Progress is reported this many times in a run.
REPORTS = 50


@dataclass(frozen=True, eq=False)
class Run:
    """memory: at the last tick. history: rows by name, (rows, ...)."""

    memory: Any
    history: dict[str, np.ndarray]


def run(process: Any, *, progress: Progress | None = None) -> Run:
    """Run all ticks of a law, any object with four members.

    ticks: number of steps. start(): the memory before the first, whatever the law carries from one tick to the next.
    advance(tick, memory): the memory after tick number `tick` (0 .. ticks - 1), a pure function. observe(tick, memory):
    the row after `tick` ticks (0 .. ticks): "time", s, and what else is to be kept, each time the same names;
    with "law_residual_norm", the residual that the law drives to zero, the progress shows it.
    """
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


def _row(process: Any, tick: int, memory: Any) -> Mapping[str, Any]:
    """A row of history; a residual that overflows is inf in it, and the law itself says when it cannot go on."""
    with np.errstate(over="ignore", invalid="ignore"):
        return process.observe(tick, memory)


def _line(row: Mapping[str, Any]) -> str:
    residual = f", residual of the law {row['law_residual_norm']:.3g}" if "law_residual_norm" in row else ""
    return f"t = {row['time']:.3g} s{residual}"
