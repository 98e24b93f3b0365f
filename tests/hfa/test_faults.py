"""Faults of the system: a full disk, closed streams, and no home folder."""

import pytest
from system_faults import NO_HOME, has_no_room, on_linux, shell, small_disk, works_without_a_home

from hfa.main import BAD_INPUT

pytestmark = on_linux
__all__ = ["small_disk"]


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


@pytest.mark.slow
@pytest.mark.parametrize("home", NO_HOME)
def test_a_missing_home_folder_keeps_the_result(tmp_path, home):
    """A sweep with a picture succeeds if the home folder is missing or not writable."""
    works_without_a_home(tmp_path, "sweep --dihedral 14:16:1 --picture a.png", home)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "free_kb"),
    [("trim --dihedral 15 -o a.json", 0), ("learn --dihedral 15 -o a.npz", 4), (PICTURE, 4)],
)
def test_a_full_disk_leaves_no_result(small_disk, words, free_kb):
    """If the disk has room for nothing, or for the first 4 KB, no part of a result is left.

    The command is refused in one line.
    """
    has_no_room(small_disk, words, free_kb)
