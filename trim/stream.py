"""Run a large sweep into a store: what is missing, on the workers, written as it comes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from hfa_model.parameters import Parameters
from trim.chunk import run_chunk
from trim.executors import workers
from trim.plan import SweepPlan
from trim.store import SweepStore, create_store, open_store

#: Points of a chunk: half a second of work or more, about 25 MB of results.
CHUNK = 25_000

_Task = tuple[tuple[str, ...], np.ndarray, Parameters, str]


def stream_sweep(
    plan: SweepPlan,
    path: Path,
    *,
    count: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> SweepStore:
    """Compute every point of the plan that the store at `path` does not hold yet.

    count, scheduler: see `executors.workers`. resume: continue an interrupted sweep; else the store must be
    new. progress is called with (chunks done, chunks in all). The results do not depend on where they were
    computed.
    """
    with workers(count, scheduler) as crew:
        store = open_store(path, plan) if resume else create_store(path, plan, CHUNK)
        total = -(-plan.count // store.chunk)
        missing = store.missing()
        done = total - len(missing)
        for number, result in crew.run(run_chunk, _tasks(plan, store.chunk, missing)):
            store.write(number, _values(plan, store.chunk, number), result)
            done += 1
            if progress is not None:
                progress(done, total)
    return store


def _tasks(plan: SweepPlan, chunk: int, missing: list[int]) -> Iterator[tuple[int, _Task]]:
    for number in missing:
        yield number, (plan.variables, _values(plan, chunk, number), plan.parameters, plan.dynamics)


def _values(plan: SweepPlan, chunk: int, number: int) -> np.ndarray:
    return plan.values(number * chunk, min((number + 1) * chunk, plan.count))
