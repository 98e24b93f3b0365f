"""`hfa` as a child process: exit codes, pipes, full disks, terminals, and imported modules."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cli import SCRIPT, hfa_process
from project import FOLDERS, ROOT

from hfa.main import BAD_INPUT, DONE, FAILED
from hfa_support.origin import PACKAGES, code


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "unbuffered"),
    [
        ("sweep --dihedral 0:20:0.5 --json -q", DONE, ""),
        ("sweep --dihedral 60 -q", FAILED, "1"),
    ],
)
def test_a_closed_pipe_changes_no_exit_code(words, code, unbuffered):
    """If the reader of the pipe has stopped, exit code and standard error are unchanged."""
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb") as pipe:
        done = subprocess.run(
            [SCRIPT, *words.split()],
            stdout=pipe,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
            timeout=120,
        )
    assert (done.returncode, done.stderr) == (code, b"")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
def test_a_full_standard_output_is_refused():
    """If standard output is a full disk, the command prints one line and returns exit code 2."""
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [SCRIPT, "trim", "--dihedral", "15"],
            stdout=full,
            stderr=subprocess.PIPE,
            timeout=120,
        )
    assert done.returncode == BAD_INPUT
    assert re.fullmatch(rb"hfa: [^\n]*No space left on device\n", done.stderr)


@pytest.mark.parametrize(
    ("name", "code", "said"),
    [
        ("SIGTERM", 143, "terminated"),
        pytest.param("SIGINT", 130, "interrupted", marks=pytest.mark.slow),
        pytest.param("SIGHUP", 143, "terminated", marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_the_run_in_one_line(tmp_path, name, code, said):
    """A run prints one line if a signal ends it, here while the file of the aircraft is executed.

    The exit code is that of shells, 128 + number of the signal. A hangup (SIGHUP) is handled as a
    termination (SIGTERM, 15).
    """
    (tmp_path / "own.py").write_text(f"import os, signal\nos.kill(os.getpid(), signal.{name})\n")
    ended = hfa_process("trim", "--aircraft", "own.py:X", folder=tmp_path)
    assert ended == (code, "", f"hfa: {said}\n")


#: Command line -> packages that its run loads besides the standard library, SciPy by subpackages.
CORE = "casadi hfa hfa_aircraft hfa_support numpy trim"
PROOFS = f"{CORE} controller flint hfa_model"
LOADED = {
    "--help": "hfa hfa_page hfa_support",
    "trim --dihedral abc": f"{CORE} hfa_model",
    f"linearize --aircraft {ROOT}/examples/uav.toml": CORE,
    "solve --dihedral 15": PROOFS,
    "fly --dihedral 15 --duration 1": f"{PROOFS} hfa_flight",
}
#: Program that runs a command and prints each loaded package, with the module that loaded it first.
LOADER = """
import sys
first = {}
class Recorder:
    def find_spec(self, name, path=None, target=None):
        package = ".".join(name.split(".")[: 1 + name.startswith("scipy.")])
        if "_" in (package[0], package.removeprefix("scipy.")[0]) or package == "scipy.version":
            return
        frame = sys._getframe(1)
        while not frame.f_globals.get("__name__", "").startswith(OWN) and frame.f_back:
            frame = frame.f_back
        first.setdefault(package, frame.f_globals.get("__name__"))
OWN = ("hfa", "controller", "trim", "verification")
sys.meta_path.insert(0, Recorder())
from hfa.main import main
main(sys.argv[1:])
for package, module in first.items():
    top = package.partition(".")[0]
    if package in sys.modules and top not in sys.stdlib_module_names and package != "scipy":
        print("loads", package, "by", module)
"""


@pytest.mark.parametrize("line", LOADED)
def test_commands_load_only_the_packages_that_they_need(line, folder):
    """A command loads no package that `LOADED` does not list for it.

    `LOADER` runs the command and prints a line "loads PACKAGE by MODULE" for each loaded package.
    """
    run = [sys.executable, "-c", LOADER, *line.split()]
    done = subprocess.run(run, capture_output=True, text=True, timeout=60, check=True)
    lines = re.findall(r"^loads (\S+) by (\S+)$", done.stdout, re.M)
    assert lines
    allowed = LOADED[line].split()
    assert [found for found in lines if found[0] not in allowed] == []


def test_the_version_is_printed_without_loading_commands():
    """`hfa --version` prints the version before modules of commands are imported. It identifies the
    code of each package.
    """
    assert {*PACKAGES} == {*FOLDERS}
    program = """
import sys
from hfa.entry import main
sys.argv[1:] = ["--version"]
code = main()
print(code, *{"argparse", "hfa.main", "hfa_support.errors", "numpy", "typing"} & {*sys.modules})
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.splitlines() == [f"hfa {code()}", "0"]
