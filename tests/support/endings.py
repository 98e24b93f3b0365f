"""Long commands that are ended from outside at some moment, and continued: what is left, and what comes out."""

from __future__ import annotations

import io
import json
import os
import random
import signal
import subprocess
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from cli import SCRIPT

#: Command -> its words.
LONG: dict[str, tuple[str, ...]] = {
    "sweep": (  # three chunks
        *("sweep", "--dihedral", "0:14:0.01", "--vary", "panel_mass=1:1.02:0.000125"),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "monte-carlo": (
        *("monte-carlo", "--dihedral", "15", "--law", "exact", "--members", "1500", "--duration", "1"),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "servo": ("servo", "order-1", "-o", "folder", "--duration", "3", "--law", "simvfa-1", "--law", "servo"),
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
    (folder / "temporary").mkdir(exist_ok=True)
    place = {**os.environ, "TMPDIR": str(folder / "temporary")}
    begun, seen = time.monotonic(), set[int]()
    process = subprocess.Popen(
        [SCRIPT, *words],
        cwd=folder,
        env=place,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
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


def ended_wrongly(
    folder: Path, name: str, moment: random.Random, expected: dict[str, Any], longest: float
) -> list[str]:
    """What is wrong with a command that is ended at a random moment by each signal in turn, and then continued."""
    words, faults = LONG[name], list[str]()
    again: tuple[str, ...] = ()
    for number, said in SIGNALS.items():
        before = _temporary(folder)  # a run that is killed may leave some
        ended = run(folder, *words, *again, number=number, after=moment.uniform(0.0, longest))
        what = f"{name}, {number.name} after {ended.seconds:.2f} s"
        if not until(lambda left=ended.workers: all(stat(each)[0] in "XZ" for each in left), 10.0):
            faults.append(f"{what}: workers are left")
        if said is not None and not (_said(ended, said) or _by_python(ended) or _finished(ended, folder, expected)):
            faults.append(f"{what}: exit code {ended.code}, {ended.err[-400:]!r}")
        elif said is not None and (left := _temporary(folder) - before):
            faults.append(f"{what}: left {sorted(left)}")
        again = _again(folder)
    last = run(folder, *words, *again)
    if last.code not in (0, 1) or result_of(folder) != expected:
        faults.append(f"{name}: continued to exit code {last.code}, {last.err[-400:]!r}, and another result")
    return faults


def _again(folder: Path) -> tuple[str, ...]:
    """--resume where there is something to continue."""
    return ("--resume",) if any((folder / each).exists() for each in ("a.zarr", "a.json", "folder")) else ()


def _said(ended: Ended, said: str) -> bool:
    lines = [line for line in ended.err.splitlines(keepends=True) if not line.startswith("hfa: note: ")]
    return lines == [said]


def _by_python(ended: Ended) -> bool:
    """Ended before Python came to the first line of the project."""
    return ended.code in (1, -signal.SIGINT, -signal.SIGTERM) and not ended.workers and "hfa_cli/" not in ended.err


def _finished(ended: Ended, folder: Path, expected: dict[str, Any]) -> bool:
    """Ended after all was done; Python itself may then be what ends."""
    return ended.code in (0, 1, -signal.SIGINT, -signal.SIGTERM) and result_of(folder) == expected


def _temporary(folder: Path) -> set[str]:
    inside = {*(folder / "temporary").glob("*"), *folder.rglob(".hfa-*")}
    return {str(path.relative_to(folder)) for path in inside}


def result_of(folder: Path) -> dict[str, Any]:
    """File -> what is in it, without when and by which words it was made."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if not path.is_file() or name.startswith(("temporary", ".")) or path.name in ("digest", "session"):
            continue  # the digest is also of the provenance
        if path.suffix == ".json":
            found[name] = _plain(json.loads(path.read_bytes()))
        elif path.suffix == ".npz":
            with zipfile.ZipFile(io.BytesIO(path.read_bytes())) as archive:
                names = [each for each in archive.namelist() if not each.startswith("provenance.")]
                found[name] = {each: archive.read(each) for each in names}
        elif path.suffix not in (".png", ".partial"):
            found[name] = path.read_bytes()
    return found


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        left = ("provenance", "digest", "checksum")
        return {key: _plain(each) for key, each in value.items() if key not in left}
    return [_plain(each) for each in value] if isinstance(value, list) else value
