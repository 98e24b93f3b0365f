"""A package's front door looks who stands before it; what users see of that is in tests/project."""

from __future__ import annotations

from pathlib import Path

import pytest

from hfa_model.support import door


def test_a_door_is_opened_after_a_look_at_what_hides_a_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = door.open_door("trim")[2]
    assert "find_operating_point" in names
    monkeypatch.setattr(door, "_path_before", lambda name: str(tmp_path) if name == "controller" else None)
    with pytest.raises(ImportError, match=f"{tmp_path} hides the package 'controller'"):
        door.open_door("trim")
