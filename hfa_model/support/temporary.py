"""Temporary files and folders that a killed run leaves go with the next run that makes one like them.

Who works in one holds a lock on it, which the system takes back when that process ends, however it ends: what bears
the name and is not locked is nobody's.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # no such locks on this system: what a killed run leaves stays
    fcntl = None  # type: ignore[assignment]

#: Letters that `tempfile` puts between prefix and suffix.
_RANDOM = 8


@contextmanager
def temporary_file(folder: Path, prefix: str, suffix: str) -> Iterator[Path]:
    """A new empty file in the folder, gone after the block unless it was renamed. OSError as from making it."""
    with _locked(folder, prefix, suffix, is_folder=False) as path:
        yield path


@contextmanager
def temporary_folder(folder: Path | None, prefix: str) -> Iterator[Path]:
    """A new folder in `folder` (None: where temporary files go), gone after the block unless it was renamed."""
    with _locked(Path(tempfile.gettempdir()) if folder is None else folder, prefix, "", is_folder=True) as path:
        yield path


@contextmanager
def _locked(folder: Path, prefix: str, suffix: str, *, is_folder: bool) -> Iterator[Path]:
    _clear(folder, prefix, suffix)
    path, lock = _made(folder, prefix, suffix, is_folder=is_folder)
    try:
        yield path
    finally:
        _remove(path)
        os.close(lock)


def _made(folder: Path, prefix: str, suffix: str, *, is_folder: bool) -> tuple[Path, int]:
    """A new file or folder, and what holds its lock; made anew where another run cleared it before it was locked."""
    while True:
        if is_folder:
            path = Path(tempfile.mkdtemp(dir=folder, prefix=prefix, suffix=suffix))
            handle = os.open(path, os.O_RDONLY) if fcntl else os.open(os.devnull, os.O_RDONLY)
        else:
            handle, name = tempfile.mkstemp(dir=folder, prefix=prefix, suffix=suffix)
            path = Path(name)
        if fcntl is not None:
            with contextlib.suppress(OSError):  # a file system without locks
                fcntl.flock(handle, fcntl.LOCK_EX)
        if path.exists():
            return path, handle
        os.close(handle)


def _clear(folder: Path, prefix: str, suffix: str) -> None:
    """Remove what bears the name, is ours, and is locked by nobody."""
    if fcntl is None:
        return
    with contextlib.suppress(OSError):
        for entry in [each for each in os.scandir(folder) if each.name.startswith(prefix)]:
            if len(entry.name) == len(prefix) + _RANDOM + len(suffix) and entry.name.endswith(suffix):
                _remove_unlocked(Path(entry.path))


def _remove_unlocked(path: Path) -> None:
    with contextlib.suppress(OSError):
        if path.lstat().st_uid != os.geteuid():
            return
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _remove(path)
        finally:
            os.close(handle)


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
