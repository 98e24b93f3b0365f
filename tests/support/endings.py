"""Long commands that are ended from outside at some moment, and continued: leftovers and results."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from cli import SCRIPT

#: Command -> its words.
LONG: dict[str, tuple[str, ...]] = {
    "sweep": (  # three chunks
        *("sweep", "--dihedral", "0:14:0.01", "--hold", "speed=66:68:0.0125"),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "monte-carlo": (
        *("monte-carlo", "--dihedral", "15", "--law", "exact", "--samples", "1500", "--duration", "1"),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "prove": ("prove", "schedule", "--dihedral", "12:15", "-o", "a.json"),
}
SIGNALS = {signal.SIGKILL: None, signal.SIGTERM: "hfa: terminated\n", signal.SIGINT: "hfa: interrupted\n"}


class Ended(NamedTuple):
    """A run: exit code, standard error, seconds, the worker processes that were seen."""

    code: int
    err: str
    seconds: float
    workers: set[int]


def stat(process: int) -> list[str]:
    """State, parent, ... of a process; "X" for one that is gone."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return ["X", "0"]


def workers(parent: int) -> list[int]:
    """Worker processes of a run; the one that looks after semaphores is none."""
    found = [int(each.name) for each in Path("/proc").iterdir() if each.name.isdigit()]
    children = [each for each in found if int(stat(each)[1]) == parent]
    return [each for each in children if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()]


def until(holds: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Wait for it; whether it came."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return holds()


def run(folder: Path, *words: str, number: signal.Signals | None = None, after: float = 0.0) -> Ended:
    """A command in a folder, with temporary files in folder/temporary; the signal comes `after` seconds.

    Ctrl-C goes to all processes of the run, as from a terminal; the others to the one that was started.
    """
    (folder / "temporary").mkdir(parents=True, exist_ok=True)
    place = {**os.environ, "TMPDIR": str(folder / "temporary")}
    begun, seen, streams = time.monotonic(), set[int](), {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    process = subprocess.Popen([SCRIPT, *words], cwd=folder, env=place, text=True, start_new_session=True, **streams)
    try:
        if number is not None:
            until(lambda: process.poll() is not None or time.monotonic() - begun > after, after + 1.0)
            seen = set(workers(process.pid))
            if process.poll() is None:
                (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
        err = process.communicate(timeout=600)[1]
    finally:
        process.kill()
    return Ended(process.returncode, err, time.monotonic() - begun, seen)


def result_of(folder: Path) -> dict[str, Any]:
    """File -> its content without date and command."""
    # The digest of a store is also of its provenance; the others are what a kill may leave.
    left, files = ("temporary", "digest", "session"), [path for path in sorted(folder.rglob("*")) if path.is_file()]
    killed = {path for path in files if path.suffix == ".partial" or ".hfa-" in str(path)}
    files = [path for path in files if path not in killed and not {*path.parts} & {*left}]
    return {
        str(path.relative_to(folder)): _plain(json.loads(path.read_bytes()))
        if path.suffix == ".json"
        else path.read_bytes()
        for path in files
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        left = ("provenance", "digest", "checksum")
        return {key: _plain(each) for key, each in value.items() if key not in left}
    return [_plain(each) for each in value] if isinstance(value, list) else value
