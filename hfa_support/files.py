"""Reading and writing of files.

A file is written completely or not at all. Input files must be regular files of limited size. Zip,
XML, TOML and JSON each have one reader with bounds, which raises BadInputError for any damage.
"""

from __future__ import annotations

import errno
import io
import json
import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING, Any

from hfa_support.errors import BadInputError, shortened

if TYPE_CHECKING:
    from xml.etree import ElementTree

#: Largest size of a file in bytes, also when unpacked. Parsing needs up to ten times this memory.
LARGEST = 2**28
#: Suffixes of the files that `hfa_support/arrays/read.py` reads.
MATRIX_FILES = (".json", ".npz", ".npy", ".mat", ".csv")
_LONGEST_REASON = 200
#: Largest depth of elements, folders and keys. Readers of elements call themselves for each level.
_DEEPEST = 150
#: Largest number of elements and attributes of an XML file. Each needs up to 1 kB.
_MOST_ELEMENTS = 2**20
#: Entities in XML files are short names of numbers.
_LONGEST_ENTITY = 100
#: A key of TOML with too many parts. The time of `tomllib` is quadratic in their number.
_DEEP_KEY = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*)"""
    f"{{{_DEEPEST}}}"
)
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
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))
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

    content = regular_file(path).read_bytes()
    try:
        text = content.decode("utf-8-sig")
        if _DEEP_KEY.search(text):
            raise ValueError(f"a key has more than {_DEEPEST} parts")
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a TOML file ({_reason(error)}); correct the file"
        ) from error


def unpacked(content: bytes) -> dict[str, bytes]:
    """Return name -> content of the members of a zip file, without its folders.

    Raises BadInputError if the file is damaged, encrypted, compressed by another method than
    deflate, unpacks to more than `LARGEST` bytes, or has a name outside its folders.
    """
    import zipfile

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if sum(entry.file_size for entry in entries) > LARGEST:
                raise ValueError(f"it unpacks to more than {LARGEST >> 20} MiB")
            members = {}
            for entry in entries:
                _refuse_name(entry.filename)
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ValueError(f"{shortened(entry.filename)} is not compressed by deflate")
                with archive.open(entry) as stream:
                    # A size makes zipfile unpack no more, also of a member that states less.
                    members[entry.filename] = stream.read(entry.file_size)
            return members
    except Exception as error:  # a damaged file makes zipfile raise nearly anything
        raise BadInputError(
            f"this is not a readable zip file ({_reason(error)}); save it again, without a password"
        ) from error


def _refuse_name(name: str) -> None:
    """Raise ValueError for the name of a member outside the folders of a zip file, or too deep."""
    parts = PurePosixPath(name).parts
    if name.startswith("/") or ".." in parts or len(parts) > _DEEPEST:
        raise ValueError(
            f"the member {shortened(name)} is outside the file, or in more than {_DEEPEST} folders"
        )


def read_xml(
    content: bytes,
    file: str,
    start: Callable[[str, dict[str, str], int], Any],
    end: Callable[[str], Any],
    text: Callable[[str, int], Any],
) -> None:
    """Call functions for the elements of an XML file, in order. No external entity is fetched.

    file: name of the file in messages
    start: called with name, attributes and line of an element
    end: called with the name of an element
    text: called with a piece of text of one line, and its line

    Raises BadInputError if the content is not XML, declares an entity other than a short text, is
    nested too deeply, has too many elements, or an unsupported encoding.
    """
    from xml.parsers import expat

    parser = expat.ParserCreate()
    parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)
    depth, count = 0, 0

    def fault(what: str) -> BadInputError:
        return BadInputError(f"{file}:{parser.CurrentLineNumber}: {what}")

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1 + len(attributes)
        if depth > _DEEPEST:
            raise fault(f"more than {_DEEPEST} levels of nested elements; nest fewer")
        if count > _MOST_ELEMENTS:
            raise fault(f"more than {_MOST_ELEMENTS} elements and attributes; give a smaller file")
        start(name, attributes, parser.CurrentLineNumber)

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1
        end(name)

    def entity(name: str, is_parameter: int, value: str | None, *_: object) -> None:
        if value is None or is_parameter or "&" in value or len(value) > _LONGEST_ENTITY:
            raise fault(
                f"the entity {shortened(name)} refers to a file, is too long or contains other "
                "entities; replace the entity by the text"
            )

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.CharacterDataHandler = lambda piece: text(piece, parser.CurrentLineNumber)
    parser.EntityDeclHandler = entity
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "")
        raise BadInputError(
            f"{file}:{error.lineno}: the file is not valid XML ({what}); correct the file"
        ) from error
    except BadInputError:
        raise
    except (LookupError, ValueError) as error:  # an encoding that Python or expat does not support
        raise BadInputError(
            f"{file}: the encoding of the file is not supported ({error}); use UTF-8"
        ) from error


def xml_root(content: bytes, file: str) -> ElementTree.Element:
    """Return the root element of an XML file, whose names keep their prefix: "m:math".

    Raises BadInputError as `read_xml`.
    """
    from xml.etree.ElementTree import TreeBuilder

    tree = TreeBuilder()
    read_xml(
        content,
        file,
        lambda name, attributes, _: tree.start(name, attributes),
        tree.end,
        lambda piece, _: tree.data(piece),
    )
    return tree.close()


def _reason(error: Exception) -> str:
    return shortened(str(error) or type(error).__name__, _LONGEST_REASON)
