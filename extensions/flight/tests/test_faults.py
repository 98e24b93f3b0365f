"""Flights and exports with an unwritable home folder or a full disk."""

from __future__ import annotations

from pathlib import Path

import pytest
from system_faults import has_no_room, on_linux, small_disk, works_without_a_home

pytestmark = on_linux
__all__ = ["small_disk"]


@pytest.mark.slow
@pytest.mark.parametrize("home", ["unset", "missing", "read-only", "a file"])
def test_a_missing_home_folder_keeps_the_result(tmp_path: Path, home: str) -> None:
    """Without a usable home folder, the result is written although machine code cannot be
    cached.
    """
    words = "fly --dihedral 15 --law exact --samples 3 --duration 0.1 -o a.zarr"
    works_without_a_home(tmp_path, words, home)


def test_a_full_disk_leaves_no_exported_file(small_disk: Path) -> None:
    """An export to a disk that has room for only one of its files leaves no file."""
    has_no_room(small_disk, "export --dihedral 15 -o folder", 12)
