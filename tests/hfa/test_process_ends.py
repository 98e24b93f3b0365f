"""How a run ends from outside: Ctrl-C, SIGTERM, SIGHUP, kill -9, a lost cluster; and what is
continued afterwards."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from cli import SCRIPT, hfa, hfa_process
from game_files import small

from hfa.exit_codes import INTERRUPTED, TERMINATED
from hfa.main import DONE, FAILED

#: Command -> its words.
LONG: dict[str, tuple[str, ...]] = {
    "sweep": (  # three chunks
        *("sweep", "--dihedral", "0:14:0.01", "--hold", "speed=66:68:0.0125"),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "monte-carlo": (
        *(
            "fly",
            "--dihedral",
            "15",
            "--law",
            "exact",
            "--samples",
            "1500",
            "--duration",
            "1",
        ),
        *("--workers", "2", "-o", "a.zarr"),
    ),
    "prove": ("prove", "schedule", "--dihedral", "12:15", "-o", "a.json"),
}
SIGNALS = {
    signal.SIGKILL: None,
    signal.SIGTERM: "hfa: terminated\n",
    signal.SIGINT: "hfa: interrupted\n",
}


class Ended(NamedTuple):
    """A run: exit code, standard output and error, seconds, the worker processes that were seen."""

    code: int
    out: str
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
    processes = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    children = [process for process in processes if int(stat(process)[1]) == parent]
    return [
        each for each in children if b"spawn_main" in Path(f"/proc/{each}/cmdline").read_bytes()
    ]


def until(holds: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Wait for it; whether it came."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.05)
    return holds()


def run(
    folder: Path,
    *words: str,
    number: signal.Signals | None = None,
    after: float = 0.0,
    working: int = 0,
) -> Ended:
    """A command in a folder, with temporary files in folder/temporary; the signal comes `after`
    seconds from where so many workers are there.

    Ctrl-C goes to all processes of the run, as from a terminal; the others to the one that was
    started."""
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
        out, err = process.communicate(timeout=600)
    finally:
        process.kill()
    return Ended(process.returncode, out, err, time.monotonic() - begun, seen)


def result_of(folder: Path) -> dict[str, Any]:
    """File -> its content without date and command."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    # What a kill may leave.
    killed = {path for path in files if path.suffix == ".partial" or ".hfa-" in str(path)}
    folders = {"temporary", "session"}
    files = [path for path in files if path not in killed and not {*path.parts} & folders]
    return {
        str(path.relative_to(folder)): (
            _plain(json.loads(path.read_bytes())) if path.suffix == ".json" else path.read_bytes()
        )
        for path in files
    }


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        dropped = ("provenance", "digest", "checksum")
        return {key: _plain(entry) for key, entry in value.items() if key not in dropped}
    return [_plain(entry) for entry in value] if isinstance(value, list) else value


RUN = {
    "sweep": (
        "sweep",
        "--dihedral",
        "0:20:1",
        "--hold",
        "panel_mass=0.1:2:0.00002",
        "--workers",
        "2",
        "-o",
        "a.zarr",
    ),
    "monte-carlo": (
        "fly",
        "--dihedral",
        "15",
        "--law",
        "exact",
        "--samples",
        "100000",
        "--workers",
        "2",
    ),
}
proc = pytest.mark.skipif(
    not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc"
)


@proc
@pytest.mark.parametrize(
    ("name", "number", "code", "said"),
    [
        pytest.param(
            "sweep", signal.SIGTERM, TERMINATED, "hfa: terminated\n", marks=pytest.mark.slow
        ),
        pytest.param(
            "sweep", signal.SIGINT, INTERRUPTED, "hfa: interrupted\n", marks=pytest.mark.slow
        ),
        pytest.param(
            "sweep", signal.SIGHUP, TERMINATED, "hfa: terminated\n", marks=pytest.mark.slow
        ),
        ("sweep", signal.SIGKILL, -signal.SIGKILL, ""),
        pytest.param(
            "monte-carlo", signal.SIGTERM, TERMINATED, "hfa: terminated\n", marks=pytest.mark.slow
        ),
        pytest.param(
            "monte-carlo", signal.SIGINT, INTERRUPTED, "hfa: interrupted\n", marks=pytest.mark.slow
        ),
    ],
)
def test_a_run_that_is_ended_leaves_no_worker_and_no_temporary_folder(
    tmp_path: Path, name: str, number: signal.Signals, code: int, said: str
) -> None:
    ended = run(tmp_path, *RUN[name], number=number, after=0.3, working=2)
    assert len(ended.workers) == 2
    assert until(lambda: all(stat(worker)[0] in "XZ" for worker in ended.workers), 10.0)
    assert (ended.code, ended.out) == (code, "")
    if number != signal.SIGKILL:
        assert ended.err == said
        assert list((tmp_path / "temporary").iterdir()) == []


#: A process that gets a signal while it loads a module, or in a destructor, where Python drops
#: exceptions.
EDGE = """
import os, signal, sys, time
from hfa import entry
class Signalled:
    def __del__(self):
        os.kill(os.getpid(), signal.{name})
class Finder:
    def find_spec(name, *_):
        if name == "{module}":
            {where}
            time.sleep(20)
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.meta_path.insert(0, Finder)
sys.exit(entry.main())
"""


@pytest.mark.parametrize(
    ("module", "where"),
    [
        ("hfa.main", "os.kill(os.getpid(), signal.{name})"),
        ("hfa.main", "Signalled()"),
        ("tomllib", "os.kill(os.getpid(), signal.{name})"),  # hfa_support.files is half loaded
    ],
)
@pytest.mark.parametrize(
    ("name", "code", "said"),
    [("SIGINT", INTERRUPTED, "hfa: interrupted\n"), ("SIGTERM", TERMINATED, "hfa: terminated\n")],
)
def test_a_signal_ends_the_run_wherever_it_comes(
    module: str, where: str, name: str, code: int, said: str
) -> None:
    program = EDGE.format(name=name, module=module, where=where.format(name=name))
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=15
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", said)


@pytest.mark.filterwarnings("default")
def test_warnings_are_notes_of_a_result_and_nothing_before_a_refusal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hfa.commands import game

    extreme = small(tmp_path / "extreme.json", A=[[1e200, 1e200], [-1e200, 3e150]])
    refused = hfa_process("solve", "--model", extreme, folder=tmp_path)
    assert (refused.code in (1, 2), refused.err.count("\n")) == (True, 1), refused.err
    plain = hfa("solve", "--model", small(tmp_path / "plant.json"))
    solve = game.solve.run

    def warning(arguments) -> int:
        for text in ("overflow\nin multiply", "overflow\nin multiply"):
            warnings.warn(text, RuntimeWarning, stacklevel=1)
        warnings.warn("two chunks were damaged", stacklevel=1)
        return solve(arguments)

    monkeypatch.setattr(game, "solve", game.solve._replace(run=warning))
    result = hfa("solve", "--model", str(tmp_path / "plant.json"))
    notes = (
        "hfa: note: two chunks were damaged\nhfa: note: while computing: overflow in multiply;"
        " check the result\n"
    )
    assert (result.code, result.out, result.err) == (plain.code, plain.out, plain.err + notes)
    assert hfa("solve", "--quiet", "--model", str(tmp_path / "plant.json")).err == ""


# Continued.

#: Runs of each command that are ended three times, once by each signal: 51 moments.
RUNS = 17


def in_one_line(ended: Ended, said: str) -> bool:
    """Ended in one line; before the command begins by Python itself; or after all was
    done."""
    lines = [
        line for line in ended.err.splitlines(keepends=True) if not line.startswith("hfa: note: ")
    ]
    by_signal = ended.code in (1, -signal.SIGINT, -signal.SIGTERM)
    by_python = by_signal and "hfa/main.py" not in ended.err
    return lines == [said] or by_python or (ended.code == 0 and not lines)


@proc
@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_ended_at_random_moments_and_continued_it_comes_to_the_same_bits(
    name: str, tmp_path: Path
) -> None:
    whole = run(tmp_path / "whole", *LONG[name])
    assert whole.code == 0
    expected = result_of(tmp_path / "whole")
    moments = random.Random(name)
    for number in range(RUNS):
        folder = tmp_path / str(number)
        again: tuple[str, ...] = ()
        for signal_number, log in SIGNALS.items():
            ended = run(
                folder,
                *LONG[name],
                *again,
                number=signal_number,
                after=moments.uniform(0.0, whole.seconds),
            )
            assert until(
                lambda seen=ended.workers: all(stat(worker)[0] in "XZ" for worker in seen), 10.0
            )
            assert log is None or in_one_line(ended, log), (number, ended)
            again = ("--resume",) if (folder / LONG[name][-1]).exists() else ()
        assert run(folder, *LONG[name], *again).code == 0
        assert result_of(folder) == expected, number


#: Four chunks.
WORDS = (
    "fly",
    "--dihedral",
    "15",
    "--law",
    "exact",
    "--samples",
    "4000",
    "--duration",
    "1",
    "-o",
    "a.zarr",
)


@contextmanager
def running(*words: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process; what it says on standard error is in log-N."""
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
def test_what_is_lost_of_a_cluster_costs_no_result(tmp_path: Path, lost: str) -> None:
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
