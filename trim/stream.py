"""Run a large job into a store: what is missing, on the workers, written as it comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from trim.executors import Task, workers
from trim.store import Layout, Store, create_store, open_store


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
    layout = job.layout
    with workers(count, scheduler) as crew:
        store = open_store(path, layout) if resume else create_store(path, layout)
        total = -(-layout.rows // store.chunk)
        missing = store.missing()
        done = total - len(missing)
        for number, result in crew.run(job.function, _tasks(job, store.chunk, missing)):
            store.write(number, result)
            done += 1
            if progress is not None:
                progress(done, total)
    return store


def _tasks(job: Job, chunk: int, missing: list[int]) -> Iterator[tuple[int, Any]]:
    for number in missing:
        yield number, job.task(number * chunk, min((number + 1) * chunk, job.layout.rows))
