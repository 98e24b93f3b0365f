"""The same Monte Carlo on Dask and on the built-in pool: whole, and in the steady state; and an empty chunk on each."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.members_case import gain_plan
from benchmarks.report import Row
from benchmarks.timing import Comparison, in_turn
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from controller.monte_carlo.stored_members import MonteCarloJob
from hfa_support.jobs.layout import Layout
from hfa_support.jobs.stream import stream
from hfa_support.jobs.workers import workers as crew

#: Members of a chunk: half a second of a core.
_CHUNK = 25

#: Watchmen that wake each worker 150 times a second by default and so take 2 % of its core (docs/scaling.md).
_QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.monitor-interval": "2s",
    "distributed.admin.tick.interval": "5s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.scheduler.work-stealing-interval": "1s",
}


class _HalfSeconds(MonteCarloJob):
    """The job with chunks of half a second."""

    @property
    def layout(self) -> Layout:  # type: ignore[override]
        return replace(super().layout, chunk=_CHUNK)


class _Times(NamedTuple):
    """Seconds a member: of the whole job, and from the time when each worker had finished a chunk."""

    whole: float
    steady: float


def rows(quick: bool = False) -> list[Row]:
    """As many processes as there are cores on either side. The cluster is running; the pool is started by each job."""
    workers = max(2, os.cpu_count() or 1)
    with _cluster(workers) as address:
        return [*_members(workers, address, quick), _empty_chunks(workers, address, quick)]


@contextmanager
def _cluster(workers: int) -> Iterator[str]:
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set(_QUIET),
        LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster,
    ):
        yield cluster.scheduler_address


def _members(workers: int, address: str, quick: bool) -> list[Row]:
    members, duration, repeats = (3 * workers * _CHUNK, 0.05, 1) if quick else (1000, 20.0, 7)
    plan = gain_plan(members, duration)
    _flown(plan, workers, scheduler=address)  # uncounted: the workers of a running cluster have their imports
    pairs = [(_flown(plan, workers, scheduler=address), _flown(plan, workers, count=workers)) for _ in range(repeats)]
    whole = Comparison.of([ours.whole for ours, _ in pairs], [peer.whole for _, peer in pairs])
    steady = Comparison.of([ours.steady for ours, _ in pairs], [peer.steady for _, peer in pairs])
    job = f"{members} members on Dask, {workers} worker processes, nonlinear aircraft under a gain, per member"
    remark = f"chunks of {_CHUNK} members, {_CHUNK * workers * steady.ours:.2f} s each"
    return [
        Row(job, f"the built-in pool of {workers} processes", whole, 1.0, remark),
        Row(f"{job}, in the steady state", f"the built-in pool of {workers} processes", steady, None),
    ]


def _empty_chunks(workers: int, address: str, quick: bool) -> Row:
    """What it costs to hand out a chunk and to hear that it is done."""
    chunks = 20 if quick else 2000

    def run(**where: Any) -> None:
        with crew(**where) as hands:
            assert len(list(hands.run(abs, ((number, (-number,)) for number in range(chunks))))) == chunks

    timing = in_turn(
        lambda: run(scheduler=address), lambda: run(count=workers), units=chunks, peer_units=chunks, repeats=3
    )
    return Row("an empty chunk on Dask", f"the built-in pool of {workers} processes, its start included", timing, None)


def _flown(plan: MonteCarlo, workers: int, **where: Any) -> _Times:
    finished: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        store = stream(
            _HalfSeconds(plan),
            Path(folder) / "members.zarr",
            progress=lambda done, total: finished.append(time.perf_counter()),
            **where,
        )
        assert store.missing() == []
    rest = plan.members * (len(finished) - workers) / len(finished)
    steady = (finished[-1] - finished[workers - 1]) / rest
    return _Times((finished[-1] - start) / plan.members, steady)
