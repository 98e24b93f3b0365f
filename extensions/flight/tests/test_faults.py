"""Exports to a full disk."""

from __future__ import annotations

from pathlib import Path

from system_faults import has_no_room, on_linux, small_disk

pytestmark = on_linux
__all__ = ["small_disk"]


def test_a_full_disk_leaves_no_exported_file(small_disk: Path) -> None:
    """An FMU that the disk has no room for leaves no file."""
    has_no_room(small_disk, "export --dihedral 15 -o aircraft.fmu", 12)
