"""Runs a law tick by tick: history, progress, and a state file from which a run goes on bit by bit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from hfa_model.support.errors import BadInputError, NoSolutionError
from hfa_model.support.files import load_npz, save_npz
from hfa_model.support.version import toolchain_version

#: Called with the fraction done (0 to 1) and one line of text.
Progress = Callable[[float, str], None]
#: What a law carries from one tick to the next.
Memory = dict[str, np.ndarray]

#: At most this many rows of history are kept of a run, evenly spread over its ticks.
MOST_ROWS = 20_001
#: The state file is rewritten and progress is reported this many times in a run.
REPORTS = 50


class Process(Protocol):
    """A learning law on one game and one stack: a start, a pure step, and what to write down."""

    @property
    def ticks(self) -> int:
        """Number of steps of a whole run."""

    def fingerprint(self) -> Mapping[str, Any]:
        """Everything that decides the outcome, so that a state file is not resumed on another run."""

    def start(self) -> Memory:
        """The memory before the first tick."""

    def advance(self, tick: int, memory: Memory) -> Memory:
        """The memory after tick number `tick` (0 .. ticks - 1)."""

    def observe(self, tick: int, memory: Memory) -> Mapping[str, Any]:
        """The row of history after `tick` ticks (0 .. ticks); holds "time" and "law_residual_norm"."""


class _Whole(NamedTuple):
    """A run after `tick` whole ticks: its memory, and how many rows of history belong to it.

    It is replaced as one value, so that an interrupt between two statements finds either the old or the new one.
    """

    tick: int
    memory: Memory
    rows: int


@dataclass(frozen=True, eq=False)
class Run:
    """memory: at the last tick. history: rows by name, (rows, ...)."""

    memory: Memory
    history: dict[str, np.ndarray]


def run(
    process: Process,
    *,
    progress: Progress | None = None,
    save_state: str | Path | None = None,
    resume: str | Path | None = None,
) -> Run:
    """Run all ticks of a law.

    save_state: .npz written `REPORTS` times in a run, at its end, and when the run is interrupted
    (KeyboardInterrupt, also raised from `progress`); a run that cannot reach its end (NoSolutionError) leaves none.
    resume: such a file; the run goes on from it and returns the same bits as an uninterrupted one. Raises
    BadInputError when the file is of another game, settings or version of the toolchain.
    """
    mark = _digest(process.fingerprint())
    if resume is not None:
        here, rows = _load(resume, mark)
    else:
        memory = process.start()
        here, rows = _Whole(0, memory, 1), [_row(process, 0, memory)]
    every = -(-process.ticks // (MOST_ROWS - 1))
    report_every = max(1, process.ticks // REPORTS)
    saved = False
    try:
        while here.tick < process.ticks:
            tick, memory = here.tick + 1, process.advance(here.tick, here.memory)
            last = tick == process.ticks
            if tick % every == 0 or last:
                rows.append(_row(process, tick, memory))
            here = _Whole(tick, memory, len(rows))
            if tick % report_every == 0 or last:
                if save_state is not None:
                    _save(save_state, mark, here, rows)
                    saved = True
                if progress is not None:
                    progress(tick / process.ticks, _line(rows[-1]))
    except KeyboardInterrupt:
        if save_state is not None:
            _save(save_state, mark, here, rows)
        raise
    except NoSolutionError:
        if save_state is not None and saved:
            Path(save_state).unlink()
        raise
    return Run(here.memory, _columns(rows))


def _row(process: Process, tick: int, memory: Memory) -> Mapping[str, Any]:
    """A row of history; a residual that overflows is inf in it, and the law itself says when it cannot go on."""
    with np.errstate(over="ignore", invalid="ignore"):
        return process.observe(tick, memory)


def _line(row: Mapping[str, Any]) -> str:
    return f"t = {row['time']:.3g} s, residual of the law {row['law_residual_norm']:.3g}"


def _columns(rows: list[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def _digest(fingerprint: Mapping[str, Any]) -> str:
    digest = hashlib.sha256(toolchain_version().encode())
    for name in sorted(fingerprint):
        value = np.asarray(fingerprint[name])
        digest.update(f"{name}{value.dtype}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def _save(path: str | Path, mark: str, here: _Whole, rows: list[Mapping[str, Any]]) -> None:
    arrays = {f"memory.{name}": np.asarray(value) for name, value in here.memory.items()}
    arrays |= {f"history.{name}": values for name, values in _columns(rows[: here.rows]).items()}
    save_npz(path, arrays | {"tick": np.array(here.tick), "mark": np.array(mark)})


def _load(path: str | Path, mark: str) -> tuple[_Whole, list[Mapping[str, Any]]]:
    data = load_npz(path)
    if "mark" not in data or "tick" not in data:
        raise BadInputError(f"{path} is not a state file of a learning run")
    if str(data["mark"]) != mark:
        raise BadInputError(f"{path} is of a run with another game, stack, law, settings or version; start anew")
    memory = {name.removeprefix("memory."): value for name, value in data.items() if name.startswith("memory.")}
    columns = {name.removeprefix("history."): value for name, value in data.items() if name.startswith("history.")}
    rows: list[Mapping[str, Any]] = [
        dict(zip(columns, values, strict=True)) for values in zip(*columns.values(), strict=True)
    ]
    return _Whole(int(data["tick"]), memory, len(rows)), rows
