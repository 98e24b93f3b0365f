"""Temporary files and folders that a killed run leaves go with the next run that makes one like them.

Who works in one holds a lock on it, which the system takes back when that process ends, however it ends: what bears
the name and is not locked is nobody's. What a signal kept from being removed goes when the process ends.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # no such locks on this system: what a killed run leaves stays
    fcntl = None  # type: ignore[assignment]

#: Letters between prefix and suffix.
_RANDOM = 16
#: What is there, or about to be. A signal may come while it is removed, or before its block began; and a generator that
#: waits in a cycle of garbage when Python ends (an exception and its frames) is never told to finish.
_THERE = set[Path]()


class _Cleared(Exception):
    """Another run took a folder that was just made for one that a killed run has left."""


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
def lock(folder: Path) -> Iterator[bool]:
    """Hold the lock on a folder while the block runs; False where another process holds it.

    The system takes it back when this process ends, however it ends. True where there are no locks.
    """
    handle = os.open(folder, os.O_RDONLY) if fcntl else os.open(os.devnull, os.O_RDONLY)
    try:
        yield _lock_now(handle)
    finally:
        os.close(handle)


def _lock_now(handle: int) -> bool:
    try:
        if fcntl is not None:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


@contextmanager
def _locked(folder: Path, prefix: str, suffix: str, *, is_folder: bool) -> Iterator[Path]:
    _clear(folder, prefix, suffix)
    # The name is known before there is anything of that name: what a signal interrupts, here too, is removed.
    path, handles = folder / f"{prefix}{secrets.token_hex(_RANDOM // 2)}{suffix}", list[int]()
    wherever = path.absolute()  # whatever folder is the current one when this process ends
    _THERE.add(wherever)
    try:
        while not path.exists():  # another run may clear it before it is locked
            with contextlib.suppress(_Cleared):
                handles.append(_made(path, is_folder=is_folder))
        yield path
    finally:
        try:
            _remove(path)
            _THERE.discard(wherever)
        finally:
            for handle in handles:
                os.close(handle)


@atexit.register
def remove_what_is_there() -> None:
    """Remove the temporary files and folders of this process; what is at work in them is over."""
    while _THERE:
        with contextlib.suppress(OSError):
            _remove(_THERE.pop())


def _made(path: Path, *, is_folder: bool) -> int:
    """A new file or folder that only its owner can read; what holds its lock."""
    if is_folder:
        path.mkdir(mode=0o700)
        try:
            handle = os.open(path, os.O_RDONLY) if fcntl else os.open(os.devnull, os.O_RDONLY)
        except FileNotFoundError as error:
            raise _Cleared from error
    else:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(handle, fcntl.LOCK_EX)
    return handle


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
