"""A file is written completely, or the old file is unchanged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfa import BadInputError
from hfa_support.files import written_whole


def save(path: Path, x: np.ndarray) -> None:
    with written_whole(path) as stream:
        np.savez(stream, x=x)


def stored(path: Path) -> list[float]:
    with np.load(path) as data:
        return list(data["x"])


def test_an_interrupted_write_keeps_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If writing a file is interrupted, the old content remains and no temporary file is left."""
    path = tmp_path / "kept.npz"
    save(path, np.arange(4.0))

    def broken(stream: Any, **arrays: Any) -> None:
        stream.write(b"half")
        raise KeyboardInterrupt

    # Ctrl-C during a write. A test cannot send the signal at this time.
    monkeypatch.setattr(np, "savez", broken)
    with pytest.raises(KeyboardInterrupt):
        save(path, np.zeros(4))
    monkeypatch.undo()
    assert stored(path) == [0.0, 1.0, 2.0, 3.0]
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.npz"]


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    """Writing into a missing folder is refused with a remedy."""
    with pytest.raises(BadInputError, match="choose a writable folder"):
        save(tmp_path / "no" / "state.npz", np.zeros(1))
