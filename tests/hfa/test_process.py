"""`hfa` as a child process: exit codes, pipes, full disks, terminals, and imported modules."""

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cli import SCRIPT, hfa, hfa_process
from project import FOLDERS

from hfa.main import BAD_INPUT, DONE, FAILED
from hfa_support.version import VERSION


@pytest.mark.slow
def test_output_of_a_process_ignores_settings(tmp_path):
    """The output of a child process does not depend on the hash seed or on color settings."""
    words = ("sweep", "--dihedral", "14:16:1")
    inside = hfa(*words)
    assert inside.code == DONE
    environment = {"PYTHONHASHSEED": "2", "FORCE_COLOR": "1", "TERM": "xterm-256color"}
    assert hfa_process(*words, folder=tmp_path, **environment) == inside


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "code", "unbuffered"),
    [
        pytest.param("sweep --dihedral 0:20:0.5 --json -q", DONE, "", marks=pytest.mark.slow),
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
    """A run that a signal ends in an aircraft's file prints one line, with the exit code of shells.

    A hangup is handled as a termination.
    """
    (tmp_path / "own.py").write_text(f"import os, signal\nos.kill(os.getpid(), signal.{name})\n")
    ended = hfa_process("trim", "--aircraft", "own.py:X", folder=tmp_path)
    assert ended == (code, "", f"hfa: {said}\n")


@pytest.mark.slow
def test_progress_is_erased_at_the_end(tmp_path):
    """On a pseudo-terminal, progress is one line, which is erased at the end.

    Standard output has no escape sequences.
    """
    controller, terminal = pty.openpty()
    with os.fdopen(terminal, "wb") as stream:
        done = subprocess.run(
            [SCRIPT, "learn", "--dihedral", "15"],
            stdout=subprocess.PIPE,
            stderr=stream,
            timeout=120,
        )
    seen = os.read(controller, 65536).decode()
    os.close(controller)
    assert done.returncode == DONE
    assert seen.endswith("\r\x1b[K")
    assert "\n" not in seen
    assert b"\x1b" not in done.stdout


#: Packages of extensions; of the page, `hfa --help` reads the entry of its command.
EXTENSIONS = [name for name, folder in FOLDERS.items() if "extensions" in folder.parts]
EXTENSIONS[EXTENSIONS.index("hfa_page")] = "hfa_page.command"
#: Command lines, and packages that they and the preceding ones must not import.
LIGHT = [
    (["--help", "frobnicate"], ["casadi", "control", "matplotlib", "numpy", "scipy"]),
    (
        ["trim --dihedral 15", "trim --dihedral abc"],
        ["matplotlib", *(f"scipy.{each}" for each in ("io", "optimize", "sparse", "spatial"))],
    ),
    (["linearize --dihedral 10"], ["controller", "verification"]),
    (
        ["solve --dihedral 15 -o gain.npz", "verify --dihedral 15 --weights gain.npz"],
        [
            "control",
            "matplotlib",
            "scipy.io",
            "scipy.signal",
            "pandas",
            "xarray",
            "onnx",
            *EXTENSIONS,
        ],
    ),
]
#: Program that runs lists of command lines and prints the imported modules after each list.
IN_TURN = """
import sys
from hfa.main import main
for commands in {lists}:
    for words in commands:
        main(words.split())
    print("imported", *sorted(sys.modules))
"""


@pytest.mark.parametrize("count", [1, pytest.param(len(LIGHT), marks=pytest.mark.slow)])
@pytest.mark.usefixtures("folder")
def test_commands_import_no_packages_that_they_do_not_need(count):
    """The commands of LIGHT import no package that is listed as unwanted for them.

    count: number of the lists that are run, of which the first is fast
    """
    lists = LIGHT[:count]
    program = IN_TURN.format(lists=[commands for commands, _ in lists])
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True
    )
    imported = [line.split() for line in done.stdout.splitlines() if line.startswith("imported ")]
    for names, (_, unwanted) in zip(imported, lists, strict=True):
        assert "hfa.main" in names
        packages = tuple(f"{each}." for each in unwanted)
        assert [name for name in names if f"{name}.".startswith(packages)] == []


def test_the_version_is_printed_without_loading_commands():
    """`hfa --version` prints the version before modules of commands are imported."""
    program = """
import sys
from hfa.entry import main
sys.argv[1:] = ["--version"]
code = main()
print(code, *{"argparse", "hfa.main", "hfa_support.errors", "numpy", "typing"} & {*sys.modules})
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert done.stdout.splitlines() == [f"hfa {VERSION}", "0"]
