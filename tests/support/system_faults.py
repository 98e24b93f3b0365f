"""Disks that are full or cannot be written."""

import subprocess
import sys
from contextlib import contextmanager

import pytest

on_linux = pytest.mark.skipif(
    sys.platform != "linux", reason="the faults are made as Linux has them"
)


@contextmanager
def disk(folder, option):
    """Mount an empty disk on a folder. The test is skipped if no disk can be mounted.

    option: of the mount, as "ro" or "size=400k"
    """
    mount = ["mount", "-t", "tmpfs", "-o", option, "none", folder]
    if subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("only who may mount can make a disk that is full, or that root cannot write")
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.fixture
def small_disk(tmp_path):
    """Yield the path of a disk of 400 KB."""
    with disk(tmp_path, "size=400k"):
        yield tmp_path
