"""Faults of the system: a full disk, closed streams, no home folder, and little memory."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from system_faults import NO_HOME, has_no_room, on_linux, shell, small_disk, works_without_a_home

from hfa.main import BAD_INPUT

pytestmark = on_linux
__all__ = ["small_disk"]


@pytest.mark.parametrize("lost", [pytest.param("2>&-", marks=pytest.mark.slow), "2>/dev/full"])
def test_a_refusal_without_streams_has_exit_code_2(tmp_path: Path, lost: str) -> None:
    """If standard error is closed or full, bad input still gives exit code 2."""
    done = shell(f'exec "$0" "$@" {lost}', "trim", "--dihedral", "abc", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (BAD_INPUT, "", "")


def test_a_closed_standard_output_is_refused(tmp_path: Path) -> None:
    """If standard output is closed, the command is refused with exit code 2 and a reason."""
    done = shell('exec "$0" "$@" >&-', "trim", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stdout) == (BAD_INPUT, "")
    assert done.stderr == (
        "hfa: standard output is closed; redirect it, for example to /dev/null\n"
    )
    done = shell('exec "$0" "$@" >/dev/null', "trim", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


_WRITES = """
from pathlib import Path
from hfa_support.files import all_or_none, write_text
with all_or_none(folder=Path("page")):
    write_text("page/a", "1")
    write_text("page/b", "1")
"""


@pytest.mark.slow
def test_files_of_two_runs_are_not_mixed(tmp_path: Path) -> None:
    """Files get their names in a folder only when no other process writes into it."""
    import fcntl

    folder = tmp_path / "page"
    folder.mkdir()
    handle = os.open(folder, os.O_RDONLY)
    fcntl.flock(handle, fcntl.LOCK_EX)
    run = subprocess.Popen([sys.executable, "-c", _WRITES], cwd=tmp_path)
    try:
        deadline = time.monotonic() + 60.0
        while len(list(folder.iterdir())) < 2 and time.monotonic() < deadline:
            time.sleep(0.02)
        time.sleep(0.2)
        assert not {"a", "b"} & {each.name for each in folder.iterdir()}
        os.close(handle)
        assert run.wait(60) == 0
    finally:
        run.kill()
    assert sorted(each.name for each in folder.iterdir()) == ["a", "b"]


@pytest.mark.parametrize(
    "words",
    [
        "solve --model {} -o {}",
        "solve --model={} --output={}",
        "trim --dihedral 15 -o {} --picture={}",
        "trim --dihedral 15 --picture new.png -onew.json --start {} --parameters new.json",
    ],
)
def test_coinciding_input_and_output_files_are_refused(tmp_path: Path, words: str) -> None:
    """An output file that is also an input file or another output file of the run is refused."""
    path = tmp_path / "plant.json"
    path.write_text("{}")
    assert_refused(hfa(*words.format(path, "./plant.json").split()), BAD_INPUT)
    assert [path.name for path in tmp_path.iterdir()] == ["plant.json"]
    assert path.read_text() == "{}"


PICTURE = "linearize --dihedral 15 --picture a.png"


@pytest.mark.slow
@pytest.mark.parametrize("home", NO_HOME)
def test_a_missing_home_folder_keeps_the_result(tmp_path: Path, home: str) -> None:
    """A sweep with a picture succeeds if the home folder is missing or not writable."""
    works_without_a_home(tmp_path, "sweep --dihedral 14:16:1 --picture a.png", home)


@pytest.mark.parametrize(
    ("words", "left"),
    [
        ("trim --dihedral 15 -o a.json", 0),
        pytest.param("learn --dihedral 15 -o a.npz", 4, marks=pytest.mark.slow),
        pytest.param(PICTURE, 4, marks=pytest.mark.slow),
        # space for the data, but not for the picture
        pytest.param(f"{PICTURE} -o a.json", 24, marks=pytest.mark.slow),
    ],
)
def test_a_full_disk_leaves_no_result(small_disk: Path, words: str, left: int) -> None:
    """If the disk is full, no part of a result is left."""
    has_no_room(small_disk, words, left)


def test_too_little_address_space_is_refused(tmp_path: Path) -> None:
    """A limit of 200 MB on the address space is refused in one line.

    Without this check, OpenBLAS would wait for memory while it is loaded.
    """
    done = shell('ulimit -v 204800; exec "$0" "$@"', "solve", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stdout) == (BAD_INPUT, "")
    assert done.stderr == (
        "hfa: this process is limited to 200 MB of address space (ulimit -v), but 384 is "
        "required; raise the limit\n"
    )


def test_too_little_memory_is_refused_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """An allocation that fails gives one line and exit code 2."""
    # A real sweep of this size would fill the memory of the test machine.
    monkeypatch.setattr("trim.sweeps.points._settled_together", lambda *_, **__: np.empty(10**15))
    assert_refused(hfa("sweep", "--dihedral", "0:5:1"), 2, "not enough memory")
