"""Stores on a full disk."""

import subprocess

import pytest
from cli import assert_refused, hfa_process
from system_faults import on_linux, small_disk

from hfa.main import BAD_INPUT, DONE

pytestmark = on_linux
__all__ = ["small_disk"]
SWEEP = [
    "sweep",
    "--dihedral",
    "12:15:0.01",
    "--hold",
    "speed=60:70:1",
    "--workers",
    "2",
    "-o",
    "a.zarr",
]


@pytest.mark.slow
def test_a_job_that_filled_disk_is_resumed(small_disk, tmp_path_factory):
    """A job that fills the disk is refused in one line. It can be resumed after the disk is
    enlarged.
    """
    elsewhere = tmp_path_factory.mktemp("elsewhere")
    full = hfa_process(*SWEEP, folder=small_disk, TMPDIR=str(elsewhere))
    assert_refused(full, BAD_INPUT, "No space left on device")
    subprocess.run(["mount", "-o", "remount,size=100m", small_disk], check=True)
    resumed = hfa_process(*SWEEP, "--resume", folder=small_disk, TMPDIR=str(elsewhere))
    assert resumed.code == DONE
    assert resumed.out == hfa_process(*SWEEP, folder=elsewhere).out
