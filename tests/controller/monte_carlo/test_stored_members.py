"""Members in a store: the same bits in any order, on any workers, whatever dies."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controller import MonteCarlo, stream_monte_carlo
from controller.monte_carlo import stored_members as monte_carlo
from controller.monte_carlo.stored_members import MonteCarloJob, fly_members
from hfa_support import BadInputError
from hfa_support.jobs.store import Store, open_store


def assert_same(first: Mapping[str, np.ndarray] | Store, second: Mapping[str, np.ndarray] | Store) -> None:
    for name in ("factors", "left", "flown", "rms_error", "peak_error", "effort", "final", "memory"):
        one, other = (each.read(name) if isinstance(each, Store) else each[name] for each in (first, second))
        assert np.array_equal(one, other), name


@pytest.fixture
def small_chunks(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two members a chunk, six chunks."""
    monkeypatch.setattr(monte_carlo, "CHUNK_STEPS", 2 * plan.scenario.ticks * plan.scenario.steps_per_tick)


def test_chunks_and_their_order_do_not_matter(plan: MonteCarlo) -> None:
    whole = fly_members(plan, 0, 6)
    last, first = fly_members(plan, 4, 6), fly_members(plan, 0, 4)
    assert_same(whole, {name: np.concatenate([first[name], last[name]]) for name in whole})
    assert MonteCarloJob(plan).layout.chunk * plan.scenario.duration / plan.scenario.step >= monte_carlo.CHUNK_STEPS


def fly_or_die(plan: MonteCarlo, start: int, stop: int) -> Mapping[str, np.ndarray]:
    """`fly_members`, but the first process that comes to member 4 kills itself."""
    flag = Path(os.environ["DIED"])
    if start == 4 and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return fly_members(plan, start, stop)


@pytest.fixture
def deadly(small_chunks: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Workers started from now on run `fly_or_die`; the file exists once one has died."""
    monkeypatch.setenv("DIED", str(tmp_path / "died"))
    monkeypatch.setattr(monte_carlo, "fly_members", fly_or_die)
    return tmp_path / "died"


@pytest.mark.slow  # test_store.py has both
def test_two_processes_give_the_bits_of_one_and_a_killed_one_loses_nothing(
    plan: MonteCarlo, deadly: Path, tmp_path: Path
) -> None:
    two = stream_monte_carlo(plan, tmp_path / "two.zarr", count=2)
    assert deadly.exists()
    assert two.missing() == []
    assert_same(two, fly_members(plan, 0, 12))


@pytest.mark.slow  # test_store.py has one by default
def test_a_dask_cluster_gives_the_same_bits_and_a_killed_worker_loses_nothing(
    plan: MonteCarlo, deadly: Path, tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        assert len({worker.pid for worker in cluster.workers.values()} - {os.getpid()}) == 2
        spread = stream_monte_carlo(plan, tmp_path / "spread.zarr", scheduler=cluster.scheduler_address)
    assert deadly.exists()
    assert spread.missing() == []
    assert_same(spread, fly_members(plan, 0, 12))


def test_a_resumed_run_simulates_only_what_is_missing(
    plan: MonteCarlo, small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stop(Exception):
        pass

    def stop_after_two(done: int, total: int) -> None:
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        stream_monte_carlo(plan, tmp_path / "part.zarr", progress=stop_after_two)
    assert len(open_store(tmp_path / "part.zarr").missing()) == 4
    flown = []
    monkeypatch.setattr(monte_carlo, "fly_members", lambda *task: flown.append(task[1:]) or fly_members(*task))
    resumed = stream_monte_carlo(plan, tmp_path / "part.zarr", resume=True)
    assert flown == [(4, 6), (6, 8), (8, 10), (10, 12)]
    assert_same(resumed, fly_members(plan, 0, 12))
    with pytest.raises(BadInputError, match="another Monte Carlo"):
        stream_monte_carlo(replace(plan, seed=8), tmp_path / "part.zarr", resume=True)
    with pytest.raises(BadInputError, match="exists"):
        stream_monte_carlo(plan, tmp_path / "part.zarr")


def test_xarray_reads_names_and_units(plan: MonteCarlo, tmp_path: Path) -> None:
    import xarray

    store = stream_monte_carlo(plan, tmp_path / "a.zarr")
    read = xarray.open_zarr(tmp_path / "a.zarr", consolidated=False)
    assert read.rms_error.dims == ("member", "error_state")
    np.testing.assert_array_equal(read.final.sel(state="speed"), store.read("final")[:, 0])
    assert str(read.state_unit.sel(state="speed").values) == "ft/s"
    assert str(read.final.state_unit.sel(state="pitch").values) == "rad"
    assert (read.flown.attrs["units"], read.effort.attrs["units_of"]) == ("s", "input_unit")
    assert [str(name) for name in read.error.values] == list(plan.scenario.uncertainty.errors)
