"""Large sweeps: any slice of a plan, the same bits wherever they run, nothing lost to a kill."""

import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from hfa_model import default_parameters
from hfa_support import BadInputError
from hfa_support.jobs import store, stream
from hfa_support.jobs.store import create_store, open_store
from hfa_support.jobs.stream import run_and_write
from trim import SweepPlan, stream_sweep
from trim.sweeps import stored_sweep
from trim.sweeps.points import trim_points
from trim.sweeps.stored_sweep import SweepJob, status_counts

PARAMETERS = default_parameters().values


def _plan(points: int = 40) -> SweepPlan:
    axes = {"dihedral": tuple(np.radians(np.linspace(0, 20, points)).tolist()), "speed": (25.0, 60.0, 68.0, 75.0)}
    return SweepPlan(axes, PARAMETERS, "published")


@pytest.fixture
def small_chunks(monkeypatch):
    monkeypatch.setattr(stored_sweep, "CHUNK", 30)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The sweep in one run, in one chunk."""
    return stream_sweep(_plan(), tmp_path_factory.mktemp("whole") / "whole.zarr")


def _same(first, second) -> bool:
    names = SweepJob(_plan()).layout.arrays
    return all(np.array_equal(first.read(name), second.read(name), equal_nan=name != "status") for name in names)


def test_two_processes_give_the_bits_of_one(tmp_path, small_chunks, whole):
    two = stream_sweep(_plan(), tmp_path / "two.zarr", count=2)
    assert status_counts(whole, 160)["missing"] == status_counts(two, 160)["missing"] == 0
    assert _same(whole, two)


def test_a_resumed_sweep_computes_only_what_is_missing(tmp_path, small_chunks, whole, monkeypatch):
    class Stop(Exception):
        pass

    def stop_after_three(done: int, total: int) -> None:
        if done == 3:
            raise Stop

    with pytest.raises(Stop):
        stream_sweep(_plan(), tmp_path / "part.zarr", progress=stop_after_three)
    left = open_store(tmp_path / "part.zarr").missing()
    assert len(left) == 3
    ran, seen = [], []
    monkeypatch.setattr(stored_sweep, "trim_points", lambda *task, **more: ran.append(1) or trim_points(*task, **more))
    resumed = stream_sweep(_plan(), tmp_path / "part.zarr", resume=True, progress=lambda *now: seen.append(now))
    assert seen == [(done, 6) for done in (3, 4, 5, 6)]  # the first before anything is computed
    assert len(ran) == len(left)
    assert _same(whole, resumed)


def test_a_store_is_neither_overwritten_nor_continued_by_another_plan(tmp_path, small_chunks):
    stream_sweep(_plan(8), tmp_path / "a.zarr")
    with pytest.raises(BadInputError, match="exists"):
        stream_sweep(_plan(8), tmp_path / "a.zarr")
    with pytest.raises(BadInputError, match="another sweep"):
        stream_sweep(_plan(9), tmp_path / "a.zarr", resume=True)
    with pytest.raises(BadInputError, match="not a sweep store"):
        stream_sweep(_plan(9), tmp_path / "nothing.zarr", resume=True)


def test_a_store_is_not_continued_by_another_version(tmp_path, small_chunks, monkeypatch):
    stream_sweep(_plan(8), tmp_path / "a.zarr")
    monkeypatch.setattr(store, "toolchain_version", lambda: "0.0.9")
    with pytest.raises(BadInputError, match=r"was begun by version \d.* and this is 0\.0\.9"):
        stream_sweep(_plan(8), tmp_path / "a.zarr", resume=True)
    assert open_store(tmp_path / "a.zarr").missing() == []  # any version reads it


def test_a_worker_that_does_not_see_the_store_sends_its_rows(tmp_path, small_chunks, whole, monkeypatch):
    sent = []

    def from_afar(path, *task):
        rows = run_and_write(tmp_path / "elsewhere" / path.name, *task)
        sent.append(isinstance(rows, dict))
        return rows

    monkeypatch.setattr(stream, "run_and_write", from_afar)
    assert _same(whole, stream_sweep(_plan(), tmp_path / "far.zarr"))
    assert sent == [True] * 6


def test_a_worker_does_not_write_into_a_copy_of_the_store(tmp_path, small_chunks):
    """A copy, left on the worker's own disk at the same path, would swallow the rows."""
    plan = _plan()
    copy = create_store(tmp_path / "a.zarr", SweepJob(plan).layout)
    task = (0, stored_sweep.run_points, SweepJob(plan).task(0, 30))
    with copy.session() as mark:
        assert isinstance(run_and_write(tmp_path / "a.zarr", "another mark", *task), dict)
        assert np.isnan(copy.read("values")).all()
        assert isinstance(run_and_write(tmp_path / "a.zarr", mark, *task), list)
    assert np.isfinite(copy.read("values", slice(30))).all()
    assert 0 in copy.missing()
    assert isinstance(run_and_write(tmp_path / "a.zarr", mark, *task), dict)


def test_kill_9_in_the_middle_of_a_sweep_leaves_whole_chunks(tmp_path, small_chunks, whole):
    script = textwrap.dedent(
        f"""
        import sys
        import time
        from pathlib import Path
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_stream import _plan
        from trim.sweeps import stored_sweep
        from hfa_support.jobs import stream
        stored_sweep.CHUNK = 30
        stored_sweep.stream_sweep(_plan(), Path({str(tmp_path / "killed.zarr")!r}), progress=lambda *_: time.sleep(0.3))
        """
    )
    process = subprocess.Popen([sys.executable, "-c", script])
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        time.sleep(0.05)
        if len(list(tmp_path.glob("killed.zarr/done/c/*"))) >= 2:
            break
    process.kill()
    process.wait()
    killed = open_store(tmp_path / "killed.zarr")
    assert 0 < len(killed.missing()) < 6
    resumed = stream_sweep(_plan(), tmp_path / "killed.zarr", resume=True)
    assert _same(resumed, whole)


@pytest.mark.slow  # that a cluster runs tasks is tried in test_workers.py, threads in test_bound.py
def test_a_dask_cluster_gives_the_same_bits(tmp_path, whole, monkeypatch):
    """Its worker runs several chunks at a time, each in a thread."""
    monkeypatch.setattr(stored_sweep, "CHUNK", 8)
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=1, threads_per_worker=4, processes=True, dashboard_address=":0") as cluster:
        spread = stream_sweep(_plan(), tmp_path / "spread.zarr", scheduler=cluster.scheduler_address)
    assert _same(whole, spread)
