"""Helpers for runs of `hfa` that are ended by a signal, and checks of the files that remain."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from cli import SCRIPT

SIGNALS = {
    signal.SIGKILL: None,
    signal.SIGTERM: "hfa: terminated\n",
    signal.SIGINT: "hfa: interrupted\n",
}

proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc"
)


class Ended(NamedTuple):
    """Result of a run that was ended by a signal.

    seconds: duration of the run
    workers: process numbers of its workers
    """

    code: int
    out: str
    err: str
    seconds: float
    workers: set[int]


def stat(process):
    """Return the fields of /proc/PID/stat, beginning with the state of the process.

    The state of an ended process is "X".
    """
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ["X", "0"]


def workers(parent):
    """Return the process numbers of the workers of a run, without Python's resource tracker.

    parent: process number of the run
    """
    processes = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    children = [process for process in processes if int(stat(process)[1]) == parent]
    return [
        each for each in children if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()
    ]


def until(holds, seconds=120.0):
    """Wait until a condition is true, at most `seconds` s, and return whether it is true."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return holds()


def run(folder, *words, number=None, after=0.0, working=0):
    """Run a command in a folder, end it by a signal, and return the result.

    number: signal, or None to let the run finish
    after: delay in seconds between the start of the workers and the signal
    working: number of workers to wait for before the delay

    Ctrl-C is sent to all processes of the run, as a terminal does. Other signals are sent only to
    the first process. The temporary files of the run are in folder/temporary.
    """
    (folder / "temporary").mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "TMPDIR": str(folder / "temporary")}
    begun = time.monotonic()
    seen = set[int]()
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen(
        [SCRIPT, *words], cwd=folder, env=environment, text=True, start_new_session=True, **streams
    )
    try:
        if number is not None:
            assert until(lambda: len(workers(process.pid)) >= working)
            end = time.monotonic() + after
            until(lambda: process.poll() is not None or time.monotonic() > end, after + 1.0)
            seen = set(workers(process.pid))
            if process.poll() is None:
                (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    return Ended(process.returncode, out, err, time.monotonic() - begun, seen)


def result_of(folder):
    """Return the content of each file in a folder by path. JSON is without dates and commands."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    # Files that may remain after SIGKILL.
    killed = {path for path in files if path.suffix == ".partial" or ".hfa-" in str(path)}
    folders = {"temporary", "session"}
    files = [path for path in files if path not in killed and not {*path.parts} & folders]
    return {
        str(path.relative_to(folder)): (
            _plain(json.loads(path.read_bytes())) if path.suffix == ".json" else path.read_bytes()
        )
        for path in files
    }


def _plain(value):
    if isinstance(value, dict):
        dropped = ("provenance", "digest", "checksum")
        return {key: _plain(entry) for key, entry in value.items() if key not in dropped}
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


def leaves_nothing(folder, words, number):
    """End a run by a signal while two workers compute, and return its result.

    The function asserts that no worker remains and, except after SIGKILL, no temporary file.
    """
    ended = run(folder, *words, number=number, after=0.3, working=2)
    assert len(ended.workers) == 2
    assert until(lambda: all(stat(worker)[0] in "XZ" for worker in ended.workers), 10.0)
    assert ended.out == ""
    assert number == signal.SIGKILL or list((folder / "temporary").iterdir()) == []
    return ended


def in_one_line(ended, said):
    """Return whether an ended run printed only the line `said`.

    The result is also True if Python ended the process before `hfa` started or if the run finished.
    """
    lines = [
        line for line in ended.err.splitlines(keepends=True) if not line.startswith("hfa: note: ")
    ]
    by_signal = ended.code in (1, -signal.SIGINT, -signal.SIGTERM)
    by_python = by_signal and "hfa/main.py" not in ended.err
    return lines == [said] or by_python or (ended.code == 0 and not lines)


def assert_resumed_bits_equal(folder, words):
    """Assert that a run ended by each signal in turn and resumed writes the bytes of a full run."""
    whole = run(folder / "whole", *words)
    assert whole.code == 0
    moments = random.Random(" ".join(words))
    place = folder / "ended"
    again = ()
    for number, said in SIGNALS.items():
        after = moments.uniform(0.0, whole.seconds)
        ended = run(place, *words, *again, number=number, after=after)
        assert until(lambda seen=ended.workers: all(stat(each)[0] in "XZ" for each in seen), 10.0)
        assert said is None or in_one_line(ended, said), ended
        again = ("--resume",) if (place / words[-1]).exists() else ()
    assert run(place, *words, *again).code == 0
    assert result_of(place) == result_of(folder / "whole")
