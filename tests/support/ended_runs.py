"""Runs of `hfa` that are ended by a signal, and the files that remain."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from cli import SCRIPT

proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc"
)


class Ended(NamedTuple):
    """Result of a run that was ended by a signal.

    workers: process numbers of its workers
    """

    code: int
    out: str
    err: str
    workers: set[str]

    def workers_have_ended(self):
        """Return whether all workers end within 10 s."""
        return until(lambda: all(map(has_ended, self.workers)), 10.0)


def has_ended(process):
    """Return whether there is no process of this number, or only a zombie."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return True
    return state in "XZ"


def workers(parent):
    """Return the process numbers of the workers of a run, without Python's resource tracker."""
    of_threads = (path.read_text() for path in Path(f"/proc/{parent}/task").glob("*/children"))
    return {
        child
        for child in " ".join(of_threads).split()
        if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()
    }


def until(holds, seconds=120.0):
    """Wait until a condition is true, at most `seconds` s, and return whether it is true."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return holds()


def run(folder, *words, number, after, working):
    """Run a command in a folder, end it by a signal, and return the result.

    number: signal
    after: delay in seconds between the start of the workers and the signal
    working: number of workers to wait for before the delay

    Ctrl-C is sent to all processes of the run, as a terminal does. Other signals are sent only to
    the first process. The temporary files of the run are in folder/temporary.
    """
    (folder / "temporary").mkdir(parents=True)
    environment = {**os.environ, "TMPDIR": str(folder / "temporary")}
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(
        [SCRIPT, *words], cwd=folder, env=environment, text=True, start_new_session=True, **streams
    )
    try:
        assert until(lambda: len(workers(process.pid)) >= working)
        time.sleep(after)
        seen = workers(process.pid)
        (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    return Ended(process.returncode, out, err, seen)
