"""Files that appear whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO

import numpy as np

from hfa_model.support.errors import BadInputError
from hfa_model.support.temporary import temporary_file


@contextmanager
def written_whole(path: str | Path) -> Iterator[IO[bytes]]:
    """A binary stream whose content becomes `path` when the block ends without an error; else nothing remains.

    Writes to a temporary file beside the target, then renames. BadInputError when the folder does not exist
    or cannot be written.
    """
    target = Path(path)
    if target.is_dir():
        raise BadInputError(f"cannot write {target}: it is a folder; name a file")
    with ExitStack() as around:
        try:
            temporary = around.enter_context(temporary_file(target.parent, f".{target.name}.", ".part"))
        except OSError as error:
            raise BadInputError(f"cannot write {target}: {error.strerror}; choose a folder that exists") from error
        with temporary.open("wb") as stream:
            yield stream
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)  # temporary files are private; a result is an ordinary one
        temporary.replace(target)


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file whole or not at all."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def write_texts(folder: Path, texts: Mapping[str, str]) -> list[Path]:
    """Write UTF-8 text files that belong together, name -> text, all or none, into a folder that is made if need be."""
    with ExitStack() as around:
        if not folder.exists():
            folder.mkdir()
            around.callback(_remove_empty, folder)
        for name, text in texts.items():
            stream = around.enter_context(written_whole(folder / name))
            stream.write(text.encode("utf-8"))
            stream.flush()  # what the disk has no room for is told before the first of them is renamed
    return [folder / name for name in texts]


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def save_npz(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays to a .npz file through a temporary file beside it and a rename.

    Raises BadInputError when the folder does not exist or cannot be written.
    """
    with written_whole(path) as stream:
        np.savez(stream, **arrays)  # type: ignore[arg-type]
