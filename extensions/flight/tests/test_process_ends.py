"""Monte Carlo simulations ended by Ctrl-C, SIGTERM or a lost cluster, and their continuation."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from cli import SCRIPT, hfa_process
from ended_runs import assert_resumed_bits_equal, leaves_nothing, proc, until

from hfa.exit_codes import INTERRUPTED, TERMINATED
from hfa.main import DONE, FAILED

EXACT = ("fly", "--dihedral", "15", "--law", "exact")
STORED = ("--workers", "2", "-o", "a.zarr")


@proc
@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        (signal.SIGTERM, TERMINATED, "hfa: terminated\n"),
        (signal.SIGINT, INTERRUPTED, "hfa: interrupted\n"),
    ],
)
def test_an_ended_run_leaves_no_workers_or_folders(
    tmp_path: Path, number: signal.Signals, code: int, said: str
) -> None:
    """After a signal, no worker process and no temporary folder remain.

    The exit code and the message are those of the signal.
    """
    words = (*EXACT, "--samples", "100000", "--workers", "2")
    ended = leaves_nothing(tmp_path, words, number)
    assert (ended.code, ended.err) == (code, said)


@proc
@pytest.mark.slow
def test_a_resumed_run_gives_identical_bits(tmp_path: Path) -> None:
    """A run that is ended at random times and continued has the same bits as one without
    interruption.
    """
    assert_resumed_bits_equal(tmp_path, (*EXACT, "--samples", "1500", "--duration", "1", *STORED))


#: Four chunks.
WORDS = (*EXACT, "--samples", "4000", "--duration", "1", "-o", "a.zarr")


@contextmanager
def running(*words: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Yield a process whose standard error is written to the file log-N, and kill it on exit."""
    with (folder / f"log-{len(list(folder.glob('log-*')))}").open("w") as log:
        process = subprocess.Popen(
            words, cwd=folder, stdout=subprocess.DEVNULL, stderr=log, text=True
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["scheduler", "worker"])
def test_a_failed_cluster_leaves_the_result_unchanged(tmp_path: Path, lost: str) -> None:
    """If a worker of Dask ends, the run completes. If the scheduler ends, it fails with one line.

    In both cases, --resume gives the report of an undisturbed run.
    """
    pytest.importorskip("distributed")
    dask = (sys.executable, "-m", "dask")
    scheduler_file = tmp_path / "scheduler.json"
    whole = tmp_path / "whole"
    whole.mkdir()
    undisturbed = hfa_process(*WORDS, folder=whole)
    scheduler = (*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    worker = (
        *dask,
        "worker",
        "--scheduler-file",
        str(scheduler_file),
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
    )
    with ExitStack() as around:
        cluster = [
            around.enter_context(
                running(*scheduler, "--scheduler-file", str(scheduler_file), folder=tmp_path)
            )
        ]
        assert until(lambda: scheduler_file.exists() and bool(scheduler_file.read_text()))
        cluster += [around.enter_context(running(*worker, folder=tmp_path)) for _ in range(2)]
        address = json.loads(scheduler_file.read_bytes())["address"]
        assert until(
            lambda: all(
                "Registered to" in (tmp_path / f"log-{number}").read_text() for number in (1, 2)
            )
        )
        run = around.enter_context(
            running(str(SCRIPT), *WORDS, "--workers", address, folder=tmp_path)
        )
        assert until(lambda: any((tmp_path / "a.zarr" / "flown").glob("c*")))
        cluster[0 if lost == "scheduler" else 1].kill()
        run.wait(timeout=120)
        log = (tmp_path / "log-3").read_text()
    assert (run.returncode, log.count("\n")) == (
        (FAILED, 1) if lost == "scheduler" else (DONE, 0)
    ), log
    resumed = hfa_process(*WORDS, "--resume", folder=tmp_path)
    assert (resumed.code, resumed.out) == (undisturbed.code, undisturbed.out)
