"""Run a large job into a store: what is missing, on the workers, written as it comes.

A worker that sees the store, on the same disk or a shared one, writes its chunk itself, so that no process is the
bottleneck of the others; from a worker that does not, the rows come back and are written here. Either way this
process alone says that a chunk is complete, after its data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Protocol

import numpy as np

from hfa_model.support.store import Layout, Store, create_store, open_store, store_in_sight
from hfa_model.support.workers import Task, workers


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
    progress: Callable[[int, int], None] | None = None,
) -> Store:
    """Compute every row of the job that the store at `path` does not hold yet.

    count, scheduler: see `executors.workers`. resume: continue an interrupted job; else the store must be new.
    progress is called with (chunks done, chunks in all). The results do not depend on where they were computed.
    """
    layout, place = job.layout, path.resolve()
    with workers(count, scheduler) as crew:
        store = open_store(place, layout) if resume else create_store(place, layout)
        total = -(-layout.rows // store.chunk)
        missing = store.missing()
        done = total - len(missing)
        with store.session() as mark:
            tasks = (
                (number, (place, mark, number, job.function, _task(job, store.chunk, number))) for number in missing
            )
            for number, rows in crew.run(run_and_write, tasks):
                if rows is not None:
                    store.write(number, rows)
                store.complete(number)
                done += 1
                if progress is not None:
                    progress(done, total)
    return store


def run_and_write(
    path: Path, mark: str, number: int, function: Callable[..., Mapping[str, np.ndarray]], task: Task
) -> Mapping[str, np.ndarray] | None:
    """Compute one chunk and write it where the store is in sight; else return it. What a worker runs."""
    rows = function(*task)
    store = store_in_sight(path, mark)
    if store is None:
        return rows
    store.write(number, rows)
    return None


def _task(job: Job, chunk: int, number: int) -> Task:
    return job.task(number * chunk, min((number + 1) * chunk, job.layout.rows))
