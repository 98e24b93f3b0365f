"""Reading and writing of files.

A file is written completely or not at all. Input files must be regular files of limited size.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import stat
import threading
import time
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from hfa_support.errors import BadInputError, shortened

#: Largest size of a file in bytes, also when unpacked. Parsing needs up to ten times this memory.
LARGEST = 2**28
#: Suffixes of the files that `hfa_support/arrays/read.py` reads.
MATRIX_FILES = (".json", ".npz", ".npy", ".mat", ".csv")
_LONGEST_REASON = 200
#: Without this flag, Windows opens a file as text.
_BINARY = getattr(os, "O_BINARY", 0)
#: Signals that end the process.
_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")
#: Number of attempts to remove a folder into which a compiler may still write.
_REMOVALS = 20


#: Temporary files and folders of this process that were not yet removed.
_UNFINISHED = set[Path]()
#: Folders that `all_or_none` created and that are still empty.
_MADE = set[Path]()
#: Inside `all_or_none`: written files that are renamed at the end, (temporary, target).
_WAITING: list[tuple[Path, Path]] | None = None
#: Inside `inputs_kept`: (device, inode) of each file and folder that was read.
_READ: set[tuple[int, int]] | None = None


@contextmanager
def inputs_kept() -> Iterator[None]:
    """Protect all files that are read in the `with` block from being overwritten in it.

    A file is recognized under any of its names. Files in a folder that was read are protected too.
    """
    global _READ
    _READ = set()
    try:
        yield
    finally:
        _READ = None


def note_read(path: str | Path) -> None:
    """Record a file or folder as input of the run. It must not be overwritten (`inputs_kept`).

    For a folder, all files in it count as inputs.
    """
    identity = _identity(path)
    if _READ is not None and identity is not None:
        _READ.add(identity)


def forget_read(path: Path) -> None:
    """Remove a file from the inputs of the run. With --resume, the run continues this file."""
    identity = _identity(path)
    if _READ is not None and identity is not None:
        _READ.discard(identity)


def refuse_read(path: Path) -> None:
    """Raise BadInputError if a file to write, or its folder, is an input of the run."""
    read = _READ or set()
    real = Path(os.path.realpath(path))
    if _identity(real) in read:
        raise BadInputError(f"{path} is an input of this run; name another file")
    if _identity(real.parent) in read:
        raise BadInputError(
            f"{path} is in a folder that this run reads as input; choose another folder"
        )


def _identity(path: str | Path) -> tuple[int, int] | None:
    """Return (device, inode) of a file, which is the same for all its names."""
    # The result is None if the file does not exist.
    try:
        status = os.stat(path)
    except (OSError, ValueError):
        return None
    return status.st_dev, status.st_ino


@contextmanager
def all_or_none(folder: Path | None = None) -> Iterator[None]:
    """Write either all or none of the files that are written in the `with` block.

    The files get their final names at the end of the block. They are removed if the block raises an
    error. The files that two processes write into the same folder are not mixed.

    folder: folder of the files, or None. It is created if it does not exist, and removed again if
        it was created and remains empty.

    Raises RuntimeError if such blocks are nested.
    """
    global _WAITING
    if _WAITING is not None:
        raise RuntimeError("all_or_none within all_or_none")
    is_new = folder is not None and not folder.exists()
    if folder is not None and is_new:
        _MADE.add(folder.absolute())
        folder.mkdir()
    _WAITING = []
    try:
        yield
        with _locked(folder), _signals_held():
            for temporary, target in _WAITING:
                temporary.replace(target)
    finally:
        for temporary, _ in _WAITING:
            temporary.unlink(missing_ok=True)
            _UNFINISHED.discard(temporary)
        _WAITING = None
        if folder is not None and is_new:
            with suppress(OSError):  # a folder with a file remains
                folder.rmdir()
            _MADE.discard(folder.absolute())


@contextmanager
def _locked(folder: Path | None) -> Iterator[None]:
    """Exclude other processes that write into a folder, if the system can lock folders."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    if folder is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network file systems have no locks
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


@contextmanager
def _signals_held() -> Iterator[None]:
    """Delay the handling of Ctrl-C, SIGTERM and SIGHUP until the end of the `with` block."""
    # The block must be short. Outside of the main thread, signals are not delayed.
    held: list[int] = []
    before: dict[int, Any] = {}
    try:
        # Python's signal handlers run in the main thread and can be set only there.
        if threading.current_thread() is threading.main_thread():
            for name in _ENDING:
                number = getattr(signal, name, None)  # not every system has every signal
                if number is not None and signal.getsignal(number) is not None:
                    before[number] = signal.signal(number, lambda number, _: held.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in held:
            signal.raise_signal(number)


@contextmanager
def temporary_folder(parent: Path | None = None) -> Iterator[Path]:
    """Yield the path of a new private folder, which is removed after the `with` block.

    A folder that the block renames is kept.

    parent: parent folder, or None for the system's folder for temporary files
    """
    import tempfile

    path = _temporary_path(Path(parent or tempfile.gettempdir()))
    try:
        path.mkdir(mode=0o700)
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _UNFINISHED.discard(path)


def _temporary_path(folder: Path) -> Path:
    """Return an unused path in a folder, and register it for removal by `remove_unfinished`."""
    # The path is registered before the file exists. A signal may end the process at any time.
    path = (folder / f".hfa-{os.urandom(8).hex()}").absolute()
    _UNFINISHED.add(path)
    return path


def _new_file(path: Path, target: Path) -> IO[bytes]:
    """Return a new file that only its owner can access, opened for writing."""
    try:
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, mode=0o600)
    except OSError as error:
        raise BadInputError(
            f"cannot write {target}: {error.strerror}; choose a writable folder"
        ) from error
    return open(handle, "wb")


def remove_unfinished() -> None:
    """Remove the temporary files and folders of this process, and its new folders that are empty.

    The function must be called just before the process ends. The removal of a folder is repeated up
    to `_REMOVALS` times, because a compiler may still write into the folder.
    """
    for path in tuple(_UNFINISHED):
        with suppress(OSError):
            path.unlink()
        for _ in range(_REMOVALS):
            shutil.rmtree(path, ignore_errors=True)
            if not path.exists():
                break
            time.sleep(0.02)
    for folder in tuple(_MADE):
        with suppress(OSError):  # a folder with a file remains
            folder.rmdir()


@contextmanager
def written_whole(path: str | Path) -> Iterator[IO[bytes]]:
    """Yield a binary stream that becomes the file `path` if the `with` block ends without an error.

    After an error the file is unchanged. Within `all_or_none`, the file is written at the end of
    that block. The permissions of an existing file are kept.

    Raises BadInputError if the folder does not exist or is not writable, or if `path` is an input,
    a folder, a FIFO or a device.
    """
    target = Path(path)
    if target.is_dir():
        raise BadInputError(f"{target} is a folder; name a file")
    if target.exists() and not target.is_file():
        raise BadInputError(f"{target} is not a regular file; name another file")
    refuse_read(target)
    temporary = _temporary_path(target.parent)
    waits = False
    try:
        with _new_file(temporary, target) as stream:
            yield stream
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(stat.S_IMODE(target.stat().st_mode) if target.exists() else 0o666 & ~umask)
        if _WAITING is not None:
            _WAITING.append((temporary, target))
            waits = True
        else:
            temporary.replace(target)
    finally:
        if not waits:
            with suppress(OSError):
                temporary.unlink()
            _UNFINISHED.discard(temporary)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, completely or not at all."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def regular_file(path: str | Path) -> Path:
    """Return a path after checking that it is a regular file of limited size, and record it as
    input.

    FIFOs and devices are refused. Reading a FIFO or device may never end.

    Raises OSError for FIFOs, devices, folders, missing files, and files larger than `LARGEST`
    bytes.
    """
    try:
        status = os.stat(path)
    except ValueError as error:  # a name with a zero byte
        raise OSError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from error
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    if status.st_size > LARGEST:
        raise OSError(errno.EFBIG, f"larger than {LARGEST >> 20} MiB", str(path))
    note_read(path)
    return Path(path)


def read_json(path: str | Path) -> Any:
    """Return the content of a JSON file.

    Raises OSError if the file cannot be read, and BadInputError if it is not valid JSON.
    """
    text = regular_file(path).read_bytes()
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not JSON ({_reason(error)}); correct the file") from error


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return the content of a TOML file in UTF-8, which may begin with a byte order mark.

    Raises OSError if the file cannot be read, and BadInputError if it is not valid TOML.
    """
    text = regular_file(path).read_bytes()
    try:
        return tomllib.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a TOML file ({_reason(error)}); correct the file"
        ) from error


def _reason(error: Exception) -> str:
    return shortened(str(error), _LONGEST_REASON)
