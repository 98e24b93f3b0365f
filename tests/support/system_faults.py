"""Simulated faults of the system: a full disk, and a home folder without write access."""

import subprocess
import sys

import pytest
from cli import SCRIPT, hfa_process

from hfa.main import BAD_INPUT, DONE

on_linux = pytest.mark.skipif(
    sys.platform != "linux", reason="the faults are made as Linux has them"
)


def shell(text, *words, folder):
    """Run a shell command in a folder. In its text, "$0" "$@" runs `hfa` with the given words."""
    return subprocess.run(
        ["sh", "-c", text, SCRIPT, *words], cwd=folder, capture_output=True, text=True, timeout=120
    )


#: Kind of fault -> shell command that sets HOME.
NO_HOME = {
    "unset": "unset HOME XDG_CACHE_HOME",
    "missing": 'export HOME="$PWD/nowhere"; unset XDG_CACHE_HOME',
    "a file": 'export HOME="$0"; export XDG_CACHE_HOME="$0"',
    "read-only": 'export HOME="$PWD/home"; unset XDG_CACHE_HOME',
}


def works_without_a_home(tmp_path, words, home):
    """Assert that a command succeeds without a usable home folder and writes nothing into it.

    home: kind of the fault, a key of NO_HOME
    """
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
def small_disk(tmp_path):
    """Yield the path of a disk of 400 KB. The test is skipped if no disk can be mounted."""
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "none", tmp_path], capture_output=True
    )
    if mounted.returncode:
        pytest.skip("only who may mount can make a small disk")
    yield tmp_path
    subprocess.run(["umount", "--lazy", tmp_path], check=True)


def has_no_room(small_disk, words, left):
    """Assert that a command fails in one line and leaves no file if the disk has `left` KB free."""
    (small_disk / "full").write_bytes(b"x" * (400 - left) * 1024)
    done = hfa_process(*words.split(), folder=small_disk)
    assert (done.code, done.err) == (
        BAD_INPUT,
        f"hfa: cannot write {words.split()[-1]}: No space left on device; choose another folder\n",
    )
    assert [path.name for path in small_disk.iterdir()] == ["full"]
