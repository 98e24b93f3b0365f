"""Executors of tasks: processes and clusters."""

import multiprocessing
import os
import time

import pytest

from hfa import BadInputError, NoSolutionError
from hfa_support.rows import workers as module
from hfa_support.rows.workers import open_workers


def _square(value):
    if value < 0:
        raise NoSolutionError(f"negative: {value}")
    return value * value


def _die(value):
    os._exit(1)


def _gone():
    """Wait up to a minute for all child processes to end, and return whether they did."""
    end = time.monotonic() + 60.0
    while multiprocessing.active_children() and time.monotonic() < end:
        time.sleep(0.02)
    return not multiprocessing.active_children()


def test_several_processes_share_the_tasks():
    """With one worker, the tasks run in this process; with two, all tasks run in other processes, of which
    none remains.
    """
    tasks = [(key, ()) for key in range(4)]
    with open_workers(1) as run:
        assert {pid for _, pid in run(os.getpid, tasks)} == {os.getpid()}
    with open_workers(2) as run:
        found = dict(run(os.getpid, tasks))
        assert dict(run(_square, [])) == {}
    assert set(found) == set(range(4))
    assert os.getpid() not in found.values()
    assert _gone()


def test_a_worker_with_other_code_is_refused(monkeypatch):
    """A worker whose sources differ from those of the process that submits tasks is refused."""
    monkeypatch.setattr(module, "toolchain", lambda: "0.4.0+0123456789ab")
    with open_workers(2) as run, pytest.raises(BadInputError, match=r"worker has hfa .*; install"):
        list(run(_square, [(0, (1,))]))


@pytest.mark.slow
def test_a_cluster_returns_all_results():
    """A Dask cluster returns all results. A task that ends its worker raises NoSolutionError."""
    dask = pytest.importorskip("dask")
    distributed = pytest.importorskip("distributed")
    # By this setting, the cluster abandons a task after one lost worker instead of four.
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as cluster,
    ):
        with open_workers(cluster.scheduler_address) as run:
            results = dict(run(abs, [(key, (-key,)) for key in range(9)]))
        assert results == {key: key for key in range(9)}
        with (
            pytest.raises(NoSolutionError, match="abandoned a chunk"),
            open_workers(cluster.scheduler_address) as run,
        ):
            list(run(_die, [(0, (0,))]))
