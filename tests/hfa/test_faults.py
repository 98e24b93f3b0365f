"""Faults of the system: a full disk, closed streams, and no home folder."""

import subprocess
from contextlib import nullcontext

import pytest
from cli import SCRIPT, hfa_process
from system_faults import disk, on_linux, small_disk

from hfa.main import BAD_INPUT, DONE

pytestmark = on_linux
__all__ = ["small_disk"]


def shell(text, *words, folder):
    """Run a shell command in a folder. In its text, "$0" "$@" runs `hfa` with the given words."""
    return subprocess.run(
        ["sh", "-c", text, SCRIPT, *words], cwd=folder, capture_output=True, text=True, timeout=120
    )


@pytest.mark.parametrize("lost", [pytest.param("2>&-", marks=pytest.mark.slow), "2>/dev/full"])
def test_a_refusal_without_streams_has_exit_code_2(tmp_path, lost):
    """If standard error is closed or full, bad input still gives exit code 2."""
    done = shell(f'exec "$0" "$@" {lost}', "trim", "--dihedral", "abc", folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (BAD_INPUT, "", "")


@pytest.mark.slow
def test_a_closed_standard_output_is_refused(tmp_path):
    """If standard output is closed, the command is refused with exit code 2 and a reason.

    /dev/null, which the reason names, is accepted.
    """
    done = shell('exec "$0" "$@" >&-', "trim", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stdout) == (BAD_INPUT, "")
    assert done.stderr == (
        "hfa: standard output is closed; redirect it, for example to /dev/null\n"
    )
    done = shell('exec "$0" "$@" >/dev/null', "trim", "--dihedral", "15", folder=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


PICTURE = "linearize --dihedral 15 --picture a.png"


#: Kind of fault -> shell command that sets HOME.
NO_HOME = {
    "unset": "unset HOME XDG_CACHE_HOME",
    "missing": 'export HOME="$PWD/nowhere"; unset XDG_CACHE_HOME',
    "a file": 'export HOME="$0"; export XDG_CACHE_HOME="$0"',
    "read-only": 'export HOME="$PWD/home"; unset XDG_CACHE_HOME',
}


@pytest.mark.slow
@pytest.mark.parametrize("home", NO_HOME)
def test_a_missing_home_folder_keeps_the_result(tmp_path, home):
    """A sweep with a picture succeeds if the home folder is missing or not writable, and writes
    nothing into it.
    """
    folder = tmp_path / "home"
    folder.mkdir()
    words = ("sweep", "--dihedral", "14:16:1", "--picture", "a.png")
    with disk(folder, "ro") if home == "read-only" else nullcontext():
        done = shell(f'{NO_HOME[home]}; exec "$0" "$@"', *words, folder=tmp_path)
    assert done.returncode == DONE, done.stderr
    assert all(line.startswith(("hfa: ", "wrote ")) for line in done.stderr.splitlines())
    assert {path.name for path in tmp_path.iterdir()} - {"nowhere"} == {"home", "a.png"}
    assert list(folder.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "free_kb"),
    [("trim --dihedral 15 -o a.json", 0), ("learn --dihedral 15 -o a.npz", 4), (PICTURE, 4)],
)
def test_a_full_disk_leaves_no_result(small_disk, words, free_kb):
    """If the disk has room for nothing, or for the first 4 KB, no part of a result is left.

    The command is refused in one line.
    """
    # The disk has 400 KB.
    (small_disk / "full").write_bytes(b"x" * (400 - free_kb) * 1024)
    done = hfa_process(*words.split(), folder=small_disk)
    assert (done.code, done.err) == (
        BAD_INPUT,
        f"hfa: cannot write {words.split()[-1]}: No space left on device; choose another folder\n",
    )
    assert [path.name for path in small_disk.iterdir()] == ["full"]
