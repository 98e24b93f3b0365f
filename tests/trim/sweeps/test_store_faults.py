"""Stores on a full disk."""

import subprocess

import pytest
from cli import assert_refused, hfa_process
from system_faults import on_linux, small_disk

from hfa.main import BAD_INPUT, DONE

pytestmark = on_linux
__all__ = ["small_disk"]
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


@pytest.mark.slow
def test_zarr_settings_do_not_affect_stores(tmp_path):
    """Environment variables of Zarr do not affect a stored sweep: its files are the same."""
    settings = {"ZARR_CODECS": "1", "ZARR_ARRAY__ORDER": "Q", "ZARR_ASYNC__CONCURRENCY": "x"}
    words = ("sweep", "--dihedral", "5,15", "-o", "a.zarr", "-q")
    written = []
    for name, variables in (("with", settings), ("without", {})):
        (tmp_path / name).mkdir()
        assert hfa_process(*words, folder=tmp_path / name, **variables).code == DONE
        store = tmp_path / name / "a.zarr"
        files = (path for path in store.rglob("*") if path.is_file())
        written.append({path.relative_to(store): path.read_bytes() for path in files})
    assert written[0] == written[1]
