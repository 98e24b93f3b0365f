"""Files are whole or what they were before."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfa_support import BadInputError
from hfa_support.files import written_whole


def save(path: Path, x: np.ndarray) -> None:
    with written_whole(path) as stream:
        np.savez(stream, x=x)


def stored(path: Path) -> list[float]:
    with np.load(path) as data:
        return list(data["x"])


def test_a_file_is_whole_or_what_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept.npz"
    save(path, np.arange(4.0))

    def broken(stream: Any, **arrays: Any) -> None:
        stream.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", broken)
    with pytest.raises(KeyboardInterrupt):
        save(path, np.zeros(4))
    monkeypatch.undo()
    assert stored(path) == [0.0, 1.0, 2.0, 3.0]
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.npz"]


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="choose a folder that exists"):
        save(tmp_path / "no" / "state.npz", np.zeros(1))
