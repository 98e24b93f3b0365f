"""Files that users bring: regular files of a bounded size, and text that parses, or one line that says why not."""

from __future__ import annotations

import errno
import json
import os
import stat
import tomllib
from pathlib import Path
from typing import Any

from hfa_model.support.echo import shortened
from hfa_model.support.errors import BadInputError

#: Bytes of a file, and of what it unpacks to.
LARGEST = 2**30
#: Bytes of a text file: parsed, it takes ten times the memory.
LARGEST_TEXT = 2**28
_LONGEST_REASON = 200


def regular_file(path: str | Path, largest: int = LARGEST) -> Path:
    """The path of a file that can be read to its end: a FIFO or a device would keep us waiting.

    OSError as from opening it, also where it is no regular file or has more than `largest` bytes.
    """
    try:
        found = os.stat(path)
    except ValueError as error:  # a name with a zero byte
        raise OSError(errno.ENOENT, os.strerror(errno.ENOENT), str(path)) from error
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", str(path))
    if found.st_size > largest:
        raise OSError(errno.EFBIG, f"larger than {largest >> 20} MiB", str(path))
    return Path(path)


def read_json(path: str | Path) -> Any:
    """What a JSON file holds. OSError where it cannot be read, BadInputError where it is no JSON."""
    text = regular_file(path, LARGEST_TEXT).read_bytes()
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path}: is not JSON ({_reason(error)})") from error


def read_toml(path: str | Path) -> dict[str, Any]:
    """What a TOML file holds. OSError where it cannot be read, BadInputError where it is no TOML."""
    text = regular_file(path, LARGEST_TEXT).read_bytes()
    try:
        return tomllib.loads(text.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path}: is not a TOML file ({_reason(error)})") from error


def _reason(error: Exception) -> str:
    return shortened(str(error), _LONGEST_REASON)
