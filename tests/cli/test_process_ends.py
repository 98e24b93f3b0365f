"""How a run ends from outside: SIGTERM as Ctrl-C, workers with their parent, nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from cli import SCRIPT, assert_refused, hfa, hfa_process
from endings import stat, until, workers
from game_files import small

from hfa_cli.main import FAILED, INTERRUPTED, TERMINATED

LONG = {
    "sweep": ("sweep", "--dihedral", "0:20:1", "--vary", "panel_mass=0.1:2:0.00002", "--workers", "2", "-o", "a.zarr"),
    "monte-carlo": ("monte-carlo", "--dihedral", "15", "--law", "exact", "--members", "100000", "--workers", "2"),
}
proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")


@proc
@pytest.mark.parametrize(
    ("name", "number", "code", "said"),
    [
        ("sweep", signal.SIGTERM, TERMINATED, "hfa: terminated\n"),
        ("sweep", signal.SIGINT, INTERRUPTED, "hfa: interrupted\n"),
        pytest.param("monte-carlo", signal.SIGTERM, TERMINATED, "hfa: terminated\n", marks=pytest.mark.slow),
        pytest.param("monte-carlo", signal.SIGINT, INTERRUPTED, "hfa: interrupted\n", marks=pytest.mark.slow),
        ("sweep", signal.SIGKILL, -signal.SIGKILL, None),
    ],
)
def test_a_run_that_is_ended_leaves_no_worker_and_no_temporary_folder(
    tmp_path: Path, name: str, number: signal.Signals, code: int, said: str | None
) -> None:
    (tmp_path / "temporary").mkdir()
    run = subprocess.Popen(
        [SCRIPT, *LONG[name]],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path / "temporary")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert until(lambda: len(workers(run.pid)) == 2)
        seen = workers(run.pid)
        time.sleep(0.3)
        # A terminal gives Ctrl-C to every process of the run.
        (os.killpg if number == signal.SIGINT else os.kill)(run.pid, number)
        out, err = run.communicate(timeout=30)
    finally:
        run.kill()
    assert until(lambda: all(stat(worker)[0] in "XZ" for worker in seen), 10.0)
    assert (run.returncode, out) == (code, "")
    if said is not None:
        assert err == said
        assert list((tmp_path / "temporary").iterdir()) == []


#: A command that a signal has ended, but not the thread of a library.
STUCK = """
import sys, threading, time
import hfa_cli.main
from hfa_cli import entry

def main():
    threading.Thread(target=time.sleep, args=(60.0,)).start()
    return hfa_cli.main.TERMINATED

hfa_cli.main.main, entry._PATIENCE = main, 0.1
sys.exit(entry.main())
"""


def test_a_thread_that_never_ends_does_not_keep_a_run_that_a_signal_ended() -> None:
    assert subprocess.run([sys.executable, "-c", STUCK], timeout=20.0, check=False).returncode == TERMINATED


def test_warnings_of_libraries_do_not_precede_a_refusal(tmp_path: Path) -> None:
    plant = small(tmp_path / "plant.json", A=[[1e200, 1e200], [-1e200, 3e150]])
    result = hfa_process("solve", "--model", plant, folder=tmp_path)
    assert result.code in (1, 2)
    assert result.err.count("\n") == 1, result.err


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"E": [[1e99], [0.0]]}, "delta = 3 is below delta_min"),
        ({"Q": [[1e-320, 0.0], [0.0, 1e-320]]}, "check the scaling of A, B, Q, R"),
    ],
)
def test_extreme_plants_are_answered_at_once(tmp_path: Path, changes: dict[str, list[list[float]]], said: str) -> None:
    begun = time.process_time()
    assert_refused(hfa("solve", "--model", small(tmp_path / "plant.json", **changes)), FAILED, said)
    assert time.process_time() - begun < 5.0


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("law", ["certified", "irl"])
def test_a_cost_that_no_number_holds_is_not_learnt(tmp_path: Path, law: str) -> None:
    """Its norm is 0, and so is all that a residual is compared with."""
    plant = small(tmp_path / "plant.json", Q=[[1e-320, 0.0], [0.0, 1e-320]])
    result = hfa("learn", "--model", plant, "--law", law)
    assert result.code in (FAILED, 2)
    assert [line for line in result.err.splitlines() if not line.startswith("hfa: ")] == []


@pytest.mark.filterwarnings("default")
def test_warnings_of_libraries_are_notes_of_a_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import warnings

    from hfa_cli.commands import solve

    plain = hfa("solve", "--model", small(tmp_path / "plant.json"))
    run = solve.run

    def warning(arguments) -> int:
        for text in ("overflow\nin multiply", "overflow\nin multiply"):
            warnings.warn(text, RuntimeWarning, stacklevel=1)
        warnings.warn("two chunks were damaged", stacklevel=1)
        return run(arguments)

    monkeypatch.setattr(solve, "run", warning)
    result = hfa("solve", "--model", str(tmp_path / "plant.json"))
    notes = "hfa: note: two chunks were damaged\nhfa: note: while computing: overflow in multiply; check the result\n"
    assert (result.code, result.out, result.err) == (plain.code, plain.out, plain.err + notes)
    assert hfa("solve", "--quiet", "--model", str(tmp_path / "plant.json")).err == ""


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [(signal.SIGINT, INTERRUPTED, "hfa: interrupted\n"), (signal.SIGTERM, TERMINATED, "hfa: terminated\n")],
)
def test_a_signal_that_compiled_code_makes_another_error_of_ends_the_run_as_what_it_was(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int, said: str
) -> None:
    def run(_: object) -> int:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            raise SystemError("a function returned a result with an exception set") from None
        return 0

    monkeypatch.setattr("hfa_cli.commands.trim.run", run)
    found = hfa("trim", "--dihedral", "5")
    assert (found.code, found.out, found.err) == (code, "", said)


class _SignalledWhenCollected:
    """Python prints what is raised in a destructor and goes on."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)
        time.sleep(0.0)


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [(signal.SIGINT, INTERRUPTED, "hfa: interrupted\n"), (signal.SIGTERM, TERMINATED, "hfa: terminated\n")],
)
def test_a_signal_that_a_destructor_swallows_ends_the_run_all_the_same(
    monkeypatch: pytest.MonkeyPatch, number: signal.Signals, code: int, said: str
) -> None:
    def run(_: object) -> int:
        _SignalledWhenCollected(number)
        time.sleep(20.0)
        return 0

    monkeypatch.setattr("hfa_cli.commands.trim.run", run)
    start = time.monotonic()
    found = hfa("trim", "--dihedral", "5")
    assert (found.code, found.err) == (code, said)
    assert time.monotonic() - start < 10.0
