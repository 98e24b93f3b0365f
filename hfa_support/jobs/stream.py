"""Run a large job into a store: what is missing, on the workers, written as it comes.

A worker that sees the store, on the same disk or a shared one, writes its chunk itself, so that no process is the
bottleneck of the others; from a worker that does not, the rows come back and are written here. Either way this
process alone says that a chunk is complete, after its data, and what its checksums are. A job that is continued
computes again what does not match them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hfa_support.jobs.layout import Layout
from hfa_support.jobs.store import Store, create_store, open_store, store_in_sight
from hfa_support.jobs.workers import Task, workers
from hfa_support.progress import Progress


class Job(Protocol):
    """N rows that any process can compute, any part of them without the rest."""

    @property
    def layout(self) -> Layout:
        """What the store of the job holds."""

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """A pure function of a module, which workers import: (*task) -> the rows of the task, one array a name."""

    def task(self, start: int, stop: int) -> Task:
        """Arguments of the function for rows start .. stop - 1."""


def stream(
    job: Job,
    path: Path,
    *,
    count: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Store:
    """Compute every row of the job that the store at `path` does not hold yet.

    count, scheduler: see `executors.workers`. resume: continue an interrupted job; else the store must be new.
    provenance: of a new store. progress is called with (chunks done, chunks in all), first at the start. The
    results do not depend on where they were computed.
    """
    layout, place = job.layout, path.resolve()
    with workers(count, scheduler) as crew:
        store = open_store(place, layout) if resume else create_store(place, layout, provenance)
        with store.session() as mark:
            if resume:
                _reopen_damaged(store, path)
            missing = store.missing()
            done = store.chunks - len(missing)
            if progress is not None and missing:
                progress(done, store.chunks)  # the first chunk may take a while: code is compiled
            tasks = (
                (number, (place, mark, number, job.function, _task(job, store.chunk, number))) for number in missing
            )
            for number, result in crew.run(run_and_write, tasks):
                store.complete(number, store.write(number, result) if isinstance(result, Mapping) else result)
                done += 1
                if progress is not None:
                    progress(done, store.chunks)
    return store


def _reopen_damaged(store: Store, path: Path) -> None:
    damaged = store.damaged()
    for number in damaged:
        store.reopen(number)
    if damaged:
        text = f"{path}: {len(damaged)} of {store.chunks} chunks were damaged and are computed again"
        warnings.warn(text, stacklevel=3)


def run_and_write(
    path: Path, mark: str, number: int, function: Callable[..., Mapping[str, np.ndarray]], task: Task
) -> Mapping[str, np.ndarray] | list[int]:
    """Compute one chunk and write it where the store is in sight, for its checksums; else return it.

    What a worker runs.
    """
    rows = function(*task)
    store = store_in_sight(path, mark)
    return rows if store is None else store.write(number, rows)


def _task(job: Job, chunk: int, number: int) -> Task:
    return job.task(number * chunk, min((number + 1) * chunk, job.layout.rows))
