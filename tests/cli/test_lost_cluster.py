"""A Dask cluster that loses a worker, or its scheduler, while a command runs on it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from cli import SCRIPT, hfa_process
from endings import until

from hfa_cli.main import DONE, FAILED

#: Four chunks.
WORDS = ("monte-carlo", "--dihedral", "15", "--law", "exact", "--samples", "4000", "--duration", "1", "-o", "a.zarr")


@contextmanager
def running(*words: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process; what it says on standard error is in log-N."""
    with (folder / f"log-{len(list(folder.glob('log-*')))}").open("w") as log:
        process = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=log, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("lost", ["scheduler", "worker"])
def test_what_is_lost_of_a_cluster_costs_no_result(tmp_path: Path, lost: str) -> None:
    pytest.importorskip("distributed")
    dask, known = str(Path(sys.executable).with_name("dask")), tmp_path / "scheduler.json"
    whole = tmp_path / "whole"
    whole.mkdir()
    undisturbed = hfa_process(*WORDS, folder=whole)
    scheduler = (dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    worker = (dask, "worker", "--scheduler-file", str(known), "--nthreads", "1", "--no-nanny", "--no-dashboard")
    with ExitStack() as around:
        cluster = [around.enter_context(running(*scheduler, "--scheduler-file", str(known), folder=tmp_path))]
        assert until(lambda: known.exists() and bool(known.read_text()))
        cluster += [around.enter_context(running(*worker, folder=tmp_path)) for _ in range(2)]
        address = json.loads(known.read_bytes())["address"]
        assert until(lambda: all("Registered to" in (tmp_path / f"log-{number}").read_text() for number in (1, 2)))
        run = around.enter_context(running(str(SCRIPT), *WORDS, "--workers", address, folder=tmp_path))
        assert until(lambda: any((tmp_path / "a.zarr" / "done").glob("c*")))
        cluster[0 if lost == "scheduler" else 1].kill()
        run.wait(timeout=120)
        said = (tmp_path / "log-3").read_text()
    assert (run.returncode, said.count("\n")) == ((FAILED, 1) if lost == "scheduler" else (DONE, 0)), said
    resumed = hfa_process(*WORDS, "--resume", folder=tmp_path)
    assert (resumed.code, resumed.out) == (undisturbed.code, undisturbed.out)
