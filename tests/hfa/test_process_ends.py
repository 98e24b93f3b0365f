"""The end of a run by a signal, and the conversion of warnings to notes."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from cli import hfa, hfa_process
from game_files import small

from hfa.exit_codes import INTERRUPTED, TERMINATED

#: Program that receives a signal while it imports a module, or in a destructor, where Python
#: discards exceptions.
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
        ("tomllib", "os.kill(os.getpid(), signal.{name})"),  # hfa_support.files is partly loaded
    ],
)
@pytest.mark.parametrize(
    ("name", "code", "said"),
    [("SIGINT", INTERRUPTED, "hfa: interrupted\n"), ("SIGTERM", TERMINATED, "hfa: terminated\n")],
)
def test_a_signal_ends_the_run_at_any_time(
    module: str, where: str, name: str, code: int, said: str
) -> None:
    """A signal ends the run with its exit code and one line, even while modules are imported."""
    program = EDGE.format(name=name, module=module, where=where.format(name=name))
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=15
    )
    assert (done.returncode, done.stdout, done.stderr) == (code, "", said)


@pytest.mark.filterwarnings("default")
def test_warnings_are_printed_as_notes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each distinct warning of a successful run is printed as a note. A failed run prints none.

    Deprecation warnings are not printed, and --quiet suppresses all notes.
    """
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
        warnings.warn("oneOf is now one_of", DeprecationWarning, stacklevel=1)
        return solve(arguments)

    # No plant causes all of these warnings of libraries.
    monkeypatch.setattr(game, "solve", game.solve._replace(run=warning))
    result = hfa("solve", "--model", str(tmp_path / "plant.json"))
    notes = (
        "hfa: note: two chunks were damaged\nhfa: note: while computing: overflow in multiply;"
        " check the result\n"
    )
    assert (result.code, result.out, result.err) == (plain.code, plain.out, plain.err + notes)
    assert hfa("solve", "--quiet", "--model", str(tmp_path / "plant.json")).err == ""
