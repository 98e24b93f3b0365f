"""Monte Carlo of flights: on all cores against one by one, and on Dask against the built-in pool."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.members_case import critic_plan, gain_plan
from benchmarks.report import Row
from benchmarks.timing import Comparison, in_turn
from controller.member_flight import fly_member
from controller.monte_carlo import MonteCarloJob, stream_monte_carlo
from controller.monte_carlo_plan import MonteCarlo
from trim.executors import workers as crew

_EFFICIENCY = 0.85


def rows(quick: bool = False) -> list[Row]:
    """All figures, with as many processes as there are cores."""
    from distributed import LocalCluster

    cores = os.cpu_count() or 1
    workers = max(2, cores)
    with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        address = cluster.scheduler_address
        on_dask = [_dask_against_pool(workers, address, quick), _empty_chunks(workers, address, quick)]
    return [_on_all_cores(cores, workers, quick), *on_dask]


def _on_all_cores(cores: int, workers: int, quick: bool) -> Row:
    """Processes started, functions compiled or loaded, members flown and stored: all of it counts."""
    members, alone, duration, repeats = (4, 1, 0.05, 1) if quick else (40 * workers, 4, 20.0, 3)
    plan = critic_plan(members, duration)

    def one_by_one() -> None:
        for member in range(alone):
            fly_member(plan, member)

    timing = in_turn(lambda: _stored(plan, count=workers), one_by_one, units=members, peer_units=alone, repeats=repeats)
    share = timing.ratio / cores
    return Row(
        f"Monte Carlo of that flight (errors, noise, turbulence) on {workers} processes, per member",
        "the members one by one",
        timing,
        _EFFICIENCY * cores,
        f"{share:.2f} of {cores} cores, {members} members a run, the start of the processes included; 1000 members "
        f"take {1000 * timing.ours / 60:.3g} min",
    )


def _dask_against_pool(workers: int, address: str, quick: bool) -> Row:
    """In the steady state: neither pays for its start, which a cluster has behind it and the pool has not."""
    chunks, repeats = (2, 1) if quick else (10, 5)
    chunk = MonteCarloJob(gain_plan(1)).layout.chunk
    plan = gain_plan(chunks * workers * chunk)
    pairs = [(_steady(plan, workers, scheduler=address), _steady(plan, workers, count=workers)) for _ in range(repeats)]
    timing = Comparison.of([ours for ours, _ in pairs], [peer for _, peer in pairs])
    return Row(
        f"Monte Carlo on Dask, {workers} worker processes, nonlinear aircraft under a gain, per member",
        f"the built-in pool of {workers} processes",
        timing,
        1.0,
        f"chunks of {chunk} members, {workers * chunk * timing.ours:.2g} s each",
    )


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


def _steady(plan: MonteCarlo, workers: int, **where: Any) -> float:
    """Seconds a member, from the time when each worker had finished a chunk to the end."""
    finished: list[float] = []
    _stored(plan, progress=lambda done, total: finished.append(time.perf_counter()), **where)
    members = plan.members * (len(finished) - workers) / len(finished)
    return (finished[-1] - finished[workers - 1]) / members


def _stored(plan: MonteCarlo, **where: Any) -> None:
    with tempfile.TemporaryDirectory() as folder:
        store = stream_monte_carlo(plan, Path(folder) / "members.zarr", **where)
        assert store.missing() == []
        assert (store.read("flown") == plan.course.duration).all(), "a member left its envelope: its flight was shorter"
