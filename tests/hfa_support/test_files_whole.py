"""A file is written completely, or the old file is unchanged."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hfa import BadInputError
from hfa_support.files import (
    all_or_none,
    remove_unfinished,
    temporary_folder,
    write_text,
    written_whole,
)


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


def test_only_temporary_files_are_removed(tmp_path: Path) -> None:
    """`remove_unfinished` removes only temporary files and folders of this process."""
    theirs = {tmp_path / ".a.json.0123456789abcdef.part", tmp_path / ".hfa-theirs"}
    for path in theirs:
        path.mkdir()
    with temporary_folder(tmp_path) as folder:
        (folder / "inside").touch()
        (folder / "kept").mkdir()
        (folder / "kept").rename(tmp_path / "kept")
    around = ExitStack()
    around.enter_context(temporary_folder(tmp_path))
    around.enter_context(all_or_none(tmp_path / "report"))
    around.enter_context(written_whole(tmp_path / "a.json"))
    assert len(set(tmp_path.iterdir()) - theirs) == 4
    remove_unfinished()  # as if a signal ended the process
    assert set(tmp_path.iterdir()) == {*theirs, tmp_path / "kept"}
    with pytest.raises(FileNotFoundError):
        around.close()
    assert set(tmp_path.iterdir()) == {*theirs, tmp_path / "kept"}


def test_a_signal_between_two_renamings_is_delayed(tmp_path: Path) -> None:
    """A signal between the renaming of two files is handled only after both are renamed."""
    seen: list[list[str]] = []
    sent: list[str] = []

    def send(event: str, _: Any) -> None:
        if event == "os.rename" and armed and not sent:
            sent.append(event)
            os.kill(os.getpid(), signal.SIGTERM)

    armed = [True]
    sys.addaudithook(send)  # cannot be removed
    before = signal.signal(
        signal.SIGTERM, lambda *_: seen.append(sorted(path.name for path in tmp_path.iterdir()))
    )
    try:
        with all_or_none():
            write_text(tmp_path / "a.json", "1")
            write_text(tmp_path / "b.json", "2")
    finally:
        armed.clear()
        signal.signal(signal.SIGTERM, before)
    assert seen == [["a.json", "b.json"]]


def test_a_temporary_file_is_removed_after_a_signal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A temporary file is removed even if a signal arrives immediately after its creation."""
    made = os.open

    def interrupted(path: Any, *arguments: Any, **options: Any) -> int:
        handle = made(path, *arguments, **options)
        assert list(tmp_path.iterdir())
        remove_unfinished()  # as a signal would do at this time
        return handle

    # A test cannot send a signal at this time.
    monkeypatch.setattr(os, "open", interrupted)
    with pytest.raises(FileNotFoundError):
        write_text(tmp_path / "a.json", "1")
    assert not list(tmp_path.iterdir())
