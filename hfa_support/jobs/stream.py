"""Run a large job into a store: the missing chunks are computed on the workers and written in order of arrival.

A process on this machine writes its chunk itself; from a cluster the rows come back and are written here. Either way
this process alone marks a chunk as complete, after its data.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from hfa_support.jobs.store import Layout, Store, create_store, open_store
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

    count, scheduler: see `workers`. resume: continue an interrupted job, and compute damaged chunks again; else the
    store must be new. provenance: of a new store. progress is called with (chunks done, chunks in all), first at the
    start. The results do not depend on where they were computed.
    """
    layout, place = job.layout, path.resolve()
    with workers(count, scheduler) as run:
        store = open_store(place, layout) if resume else create_store(place, layout, provenance)
        damaged = store.damaged() if resume else []
        for number in damaged:
            store.reopen(number)
        if damaged:
            text = f"{path}: {len(damaged)} of {store.chunks} chunks were damaged and are computed again"
            warnings.warn(text, stacklevel=2)
        missing = store.missing()
        show = progress if progress is not None and missing else lambda *_: None
        show(store.chunks - len(missing), store.chunks)  # the first chunk may take a while: code is compiled
        here = place if scheduler is None else None
        tasks = (
            (number, (here, number, job.function, job.task(number * store.chunk, store.end(number))))
            for number in missing
        )
        for done, (number, rows) in enumerate(run(_run_and_write, tasks), start=store.chunks - len(missing) + 1):
            if rows is not None:
                store.write(number, rows)
            store.complete(number)
            show(done, store.chunks)
    return store


def _run_and_write(
    path: Path | None, number: int, function: Callable[..., Mapping[str, np.ndarray]], task: Task
) -> Mapping[str, np.ndarray] | None:
    """Compute one chunk and write it into the store at a path; without one return it. What a worker runs."""
    rows = function(*task)
    if path is None:
        return rows
    Store(path, "r+").write(number, rows)
    return None
