"""What the system refuses or takes away: a full disk, a home that cannot be written, settings that
are none."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cli import SCRIPT, assert_refused, hfa, hfa_process

from hfa.main import BAD_INPUT, DONE

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="the faults are made as Linux has them"
)
SWEEP = (
    "sweep",
    "--dihedral",
    "12:15:0.01",
    "--hold",
    "speed=60:70:1",
    "--workers",
    "2",
    "-o",
    "a.zarr",
)


def shell(text: str, *words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A line of sh, in which "$0" "$@" is `hfa` with the words."""
    return subprocess.run(
        ["sh", "-c", text, SCRIPT, *words], cwd=folder, capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("lost", [pytest.param("2>&-", marks=pytest.mark.slow), "2>/dev/full"])
def test_a_refusal_that_nobody_can_read_is_its_exit_code(tmp_path: Path, lost: str) -> None:
    done = shell(f'exec "$0" "$@" {lost}', "trim", "--dihedral", "abc", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (BAD_INPUT, "", "")


@pytest.mark.parametrize(
    "words",
    [
        "solve --model {} -o {}",
        "solve --model={} --output={}",
        "trim --dihedral 15 -o {} --picture={}",
        "trim --dihedral 15 --picture new.png -onew.json --start {} --parameters new.json",
    ],
)
def test_what_is_written_is_no_input_and_no_other_output(tmp_path: Path, words: str) -> None:
    path = tmp_path / "plant.json"
    path.write_text("{}")
    assert_refused(hfa(*words.format(path, "./plant.json").split()), BAD_INPUT)
    assert [path.name for path in tmp_path.iterdir()] == ["plant.json"]
    assert path.read_text() == "{}"


#: Where HOME is: a line of sh before the command.
NO_HOME = {
    "unset": "unset HOME XDG_CACHE_HOME",
    "missing": 'export HOME="$PWD/nowhere"; unset XDG_CACHE_HOME',
    "a file": 'export HOME="$0"; export XDG_CACHE_HOME="$0"',
    "read-only": 'export HOME="$PWD/home"; unset XDG_CACHE_HOME',
}


PICTURE = "trim --dihedral 15 --picture a.png"
MACHINE_CODE = "fly --dihedral 15 --law exact --samples 3 --duration 0.1 -o a.zarr"


@pytest.mark.parametrize(
    ("words", "home"),
    [
        (PICTURE, "unset"),
        *(
            pytest.param(PICTURE, home, marks=pytest.mark.slow)
            for home in ("read-only", "a file", "missing")
        ),
        *(
            pytest.param(MACHINE_CODE, home, marks=pytest.mark.slow)
            for home in ("unset", "missing", "read-only", "a file")
        ),
    ],
)
def test_without_a_home_that_can_be_written_the_result_is_there(
    tmp_path: Path, words: str, home: str
) -> None:
    """Caches of machine code and of fonts are done without; nothing appears where HOME was."""
    folder = tmp_path / "home"
    folder.mkdir()
    if home == "read-only":
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "ro", "none", folder], capture_output=True
        )
        if mounted.returncode:
            pytest.skip("only who may mount can make a disk that not even root can write")
    try:
        done = shell(f'{NO_HOME[home]}; exec "$0" "$@"', *words.split(), folder=tmp_path)
    finally:
        if home == "read-only":
            subprocess.run(["umount", "--lazy", folder], check=True)
    assert done.returncode == DONE, done.stderr
    assert all(line.startswith(("hfa: ", "wrote ")) for line in done.stderr.splitlines())
    assert {path.name for path in tmp_path.iterdir()} - {"nowhere"} == {"home", words.split()[-1]}
    assert list(folder.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 400 KB."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "none", tmp_path], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("only who may mount can make a small disk")
    yield tmp_path
    subprocess.run(["umount", "--lazy", tmp_path], check=True)


@pytest.mark.slow  # three processes; what a full disk leaves is tried below, what resumes in test_store.py
def test_a_job_that_filled_the_disk_goes_on_when_there_is_room(
    small_disk: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    full = hfa_process(*SWEEP, folder=small_disk, TMPDIR=str(elsewhere))
    assert (full.code, full.out) == (BAD_INPUT, "")
    assert full.err == "hfa: cannot write the output: No space left on device\n"
    subprocess.run(["mount", "-o", "remount,size=100m", small_disk], check=True)
    resumed = hfa_process(*SWEEP, "--resume", folder=small_disk, TMPDIR=str(elsewhere))
    assert resumed.code == DONE
    assert resumed.out == hfa_process(*SWEEP, folder=elsewhere).out


@pytest.mark.parametrize(
    ("words", "left"),
    [
        pytest.param("learn --dihedral 15 -o a.npz", 4, marks=pytest.mark.slow),
        pytest.param("trim --dihedral 15 --picture a.png", 4, marks=pytest.mark.slow),
        # room for the data, not for the picture
        pytest.param("trim --dihedral 15 -o a.json --picture a.png", 24, marks=pytest.mark.slow),
        ("export --dihedral 15 -o folder", 12),  # room for the header, not for the rest
    ],
)
def test_a_result_that_the_disk_has_no_room_for_is_not_there(
    small_disk: Path, words: str, left: int
) -> None:
    (small_disk / "full").write_bytes(b"x" * (400 - left) * 1024)
    done = hfa_process(*words.split(), folder=small_disk)
    assert (done.code, done.err) == (
        BAD_INPUT,
        "hfa: cannot write the output: No space left on device\n",
    )
    assert [path.name for path in small_disk.iterdir()] == ["full"]


def test_too_little_address_space_is_one_line(tmp_path: Path) -> None:
    """OpenBLAS would wait for memory while it is loaded, where no signal reaches Python."""
    done = shell('ulimit -v 204800; exec "$0" "$@"', "solve", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stdout) == (BAD_INPUT, "")
    assert done.stderr == (
        "hfa: this process may have 200 MB of address space (ulimit -v) and needs 384; allow more\n"
    )


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trim.sweeps.points._settled_together", lambda *_, **__: np.empty(10**15))
    assert_refused(hfa("sweep", "--dihedral", "0:5:1"), 2, "not enough memory")
