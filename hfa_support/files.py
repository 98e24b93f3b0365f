"""Reading and writing of files.

A file is written completely or not at all. Input files must be regular files of limited size.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from hfa_support.errors import BadInputError, shortened

#: Largest size of a file in bytes, also when unpacked. Parsing needs up to ten times this memory.
LARGEST = 2**28
#: Suffixes of the files that `hfa_support/arrays/read.py` reads.
MATRIX_FILES = (".json", ".npz", ".npy", ".mat", ".csv")
_LONGEST_REASON = 200
#: Inside `inputs_kept`: real paths of the files that were read.
_INPUTS: set[str] | None = None


@contextmanager
def inputs_kept() -> Iterator[None]:
    """Protect all files that are read in the `with` block from being overwritten in it."""
    global _INPUTS
    _INPUTS = set()
    try:
        yield
    finally:
        _INPUTS = None


def note_read(path: str | Path) -> None:
    """Record a file as an input of the run (`inputs_kept`)."""
    if _INPUTS is not None:
        _INPUTS.add(os.path.realpath(path))


def refuse_read(path: Path) -> None:
    """Raise BadInputError if a file to write is an input of the run."""
    if _INPUTS is not None and os.path.realpath(path) in _INPUTS:
        raise BadInputError(f"{path} is an input of this run; name another file")


@contextmanager
def written_whole(path: str | Path) -> Iterator[IO[bytes]]:
    """Yield a binary stream that becomes the file `path` if the `with` block ends without an error.

    After an error the file is unchanged. The permissions of an existing file are kept.

    Raises BadInputError if the folder does not exist or is not writable, or if `path` is an input,
    a folder, a FIFO or a device.
    """
    target = Path(path)
    if target.is_dir():
        raise BadInputError(f"{target} is a folder; name a file")
    if target.exists() and not target.is_file():
        raise BadInputError(f"{target} is not a regular file; name another file")
    refuse_read(target)
    temporary = target.with_name(f".hfa-{os.urandom(8).hex()}")
    try:
        stream = temporary.open("xb")
    except OSError as error:
        raise BadInputError(
            f"cannot write {target}: {error.strerror}; choose a writable folder"
        ) from error
    try:
        with stream:
            yield stream
        if target.exists():
            shutil.copymode(target, temporary)
        temporary.replace(target)
    except OSError as error:
        own_names = (str(target), str(temporary))
        if error.filename is not None and str(error.filename) not in own_names:
            raise  # an error of another file, in the `with` block
        raise BadInputError(
            f"cannot write {target}: {error.strerror}; choose another folder"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, completely or not at all."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def regular_file(path: str | Path) -> Path:
    """Return a path after checking that it is a regular file of limited size, an input of the run.

    Raises OSError for FIFOs and devices, whose reading may never end, and for folders, missing
    files, and files larger than `LARGEST` bytes.
    """
    file = Path(path)
    if not file.exists():  # also of a name with a zero byte
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not file.is_file():
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    if file.stat().st_size > LARGEST:
        raise OSError(errno.EFBIG, f"larger than {LARGEST >> 20} MiB", str(path))
    note_read(file)
    return file


def resolved(path: str | Path) -> Path:
    """Return the absolute path without links, also of a link to itself, which cannot be read."""
    return Path(os.path.realpath(path))


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
    import tomllib

    text = regular_file(path).read_bytes()
    try:
        return tomllib.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a TOML file ({_reason(error)}); correct the file"
        ) from error


def _reason(error: Exception) -> str:
    return shortened(str(error), _LONGEST_REASON)
