"""Files: how they are read and written, and the entries that they may have."""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING, Any, NamedTuple

from hfa_support.errors import BadInputError, choice_of, shortened, shown

if TYPE_CHECKING:
    from xml.etree import ElementTree


#: Largest size of a file in bytes, also when unpacked. Parsing needs up to ten times this memory.
LARGEST = 2**28
#: Suffixes of the files that `hfa_support/arrays/read.py` reads.
MATRIX_FILES = (".json", ".npz", ".npy", ".mat", ".csv")
#: Suffixes of tables (`hfa_support/arrays/tables.py`), the last ones by pandas.
TABLE_FILES = (*MATRIX_FILES, ".txt", ".tsv", ".dat", ".parquet", ".feather", ".xlsx")
_LONGEST_REASON = 200
#: Largest depth of elements, folders and keys: readers are recursive.
_DEEPEST = 150
#: A key of TOML with too many parts. The time of `tomllib` is quadratic in their number.
_DEEP_KEY = re.compile(
    r"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*)"""
    f"{{{_DEEPEST}}}"
)
#: Largest number of elements and attributes of an XML file. Each needs up to 1 kB.
_MOST_XML_ENTRIES = 2**20
#: Inside `inputs_kept`: real paths of the files that were read.
_FILES_READ: set[str] | None = None


@contextmanager
def inputs_kept() -> Iterator[None]:
    """Protect the files that are read in the `with` block from being overwritten in it."""
    global _FILES_READ
    _FILES_READ = set()
    try:
        yield
    finally:
        _FILES_READ = None


def note_read(path: str | Path) -> None:
    """Record a file as an input of the run (`inputs_kept`)."""
    if _FILES_READ is not None:
        _FILES_READ.add(os.path.realpath(path))


def refuse_read(path: Path) -> None:
    """Raise BadInputError if a file to write is an input of the run."""
    if _FILES_READ is not None and os.path.realpath(path) in _FILES_READ:
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
    with _moved_whole(target) as temporary:
        with temporary.open("xb") as stream:
            yield stream
        if target.exists():
            temporary.chmod(stat.S_IMODE(target.stat().st_mode))


@contextmanager
def folder_written_whole(path: str | Path) -> Iterator[Path]:
    """Yield a new folder that becomes the folder `path` if the `with` block ends without an error.

    Raises BadInputError if `path` is a folder with files, or if it cannot be written.
    """
    target = Path(path)
    if target.exists() and any(target.iterdir()):
        raise BadInputError(f"{target} has files; delete it, or choose another name")
    with _moved_whole(target) as temporary:
        temporary.mkdir()
        yield temporary
        if target.exists():
            target.rmdir()


@contextmanager
def _moved_whole(target: Path) -> Iterator[Path]:
    """Yield a path beside a file or folder. What the `with` block writes there is moved to the file
    or folder, or deleted after an error.
    """
    temporary = target.with_name(f".hfa-{os.urandom(8).hex()}")
    try:
        yield temporary
        temporary.replace(target)
    except OSError as error:
        if error.filename is not None:
            named = Path(os.fsdecode(error.filename))
            if not {target, temporary} & {named, *named.parents}:
                raise  # of another file, in the `with` block
        # A folder in which the temporary file was made is writable, but full.
        which = "another" if temporary.exists() else "a writable"
        raise BadInputError(
            f"cannot write {target}: {error.strerror}; choose {which} folder"
        ) from error
    except BadInputError as error:  # of a file inside the folder
        raise BadInputError(str(error).replace(str(temporary), str(target))) from error
    finally:
        if temporary.is_dir():
            import shutil

            shutil.rmtree(temporary)
        temporary.unlink(missing_ok=True)


def write_text(path: str | Path, text: str) -> None:
    """Write a text file in UTF-8, completely or not at all."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def regular_file(path: str | Path) -> Path:
    """Return a path after checking that it is a regular file of limited size, and record the file
    as an input of the run.

    Raises OSError for FIFOs and devices, whose reading may never end, and for folders, missing
    files, and files larger than `LARGEST` bytes.
    """
    file = Path(path)
    if not file.exists():  # also of a name with a zero byte
        number, reason = errno.ENOENT, os.strerror(errno.ENOENT)
    elif file.is_dir():
        number, reason = errno.EISDIR, os.strerror(errno.EISDIR)
    elif not file.is_file():
        number, reason = errno.EINVAL, "not a regular file"
    elif file.stat().st_size > LARGEST:
        number, reason = errno.EFBIG, f"larger than {LARGEST >> 20} MiB"
    else:
        note_read(file)
        return file
    raise OSError(number, reason, str(path))  # Python chooses the subclass by the number


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
                name = entry.filename
                parts = PurePosixPath(name).parts
                if name.startswith("/") or ".." in parts or len(parts) > _DEEPEST:
                    raise ValueError(
                        f"the member {shortened(name)} is outside the file, or in more than "
                        f"{_DEEPEST} folders"
                    )
                if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                    raise ValueError(f"{shortened(name)} is not compressed by deflate")
                with archive.open(entry) as stream:
                    # A member that unpacks to more than it states is not read further.
                    members[name] = stream.read(entry.file_size)
            return members
    except Exception as error:  # a damaged file makes zipfile raise nearly anything
        raise BadInputError(
            f"this is not a readable zip file ({_reason(error)}); save it again, without a password"
        ) from error


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

    Raises BadInputError if the content is not XML, refers to another file, is nested too deeply,
    has too many elements, or an unsupported encoding.
    """
    from xml.parsers import expat

    parser = expat.ParserCreate()
    depth, count = 0, 0

    def fault(what: str) -> BadInputError:
        """Return an error with the present line of the file."""
        return BadInputError(f"{file}:{parser.CurrentLineNumber}: {what}")

    def opened(name: str, attributes: dict[str, str]) -> None:
        """Count an element, and refuse one that is too deep or one too many."""
        nonlocal depth, count
        depth, count = depth + 1, count + 1 + len(attributes)
        if depth > _DEEPEST:
            raise fault(f"more than {_DEEPEST} levels of nested elements; nest fewer")
        if count > _MOST_XML_ENTRIES:
            raise fault(
                f"more than {_MOST_XML_ENTRIES} elements and attributes; give a smaller file"
            )
        start(name, attributes, parser.CurrentLineNumber)

    def closed(name: str) -> None:
        """Leave the level of an element."""
        nonlocal depth
        depth -= 1
        end(name)

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.CharacterDataHandler = lambda piece: text(piece, parser.CurrentLineNumber)
    parser.ExternalEntityRefHandler = lambda *_: 0  # refused
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
    """Return the text of an error, or its kind if it has no text."""
    return shortened(str(error) or type(error).__name__, _LONGEST_REASON)


class Number(NamedTuple):
    """Declaration of a number in a file, from `lowest` to `highest`.

    lowest, highest: limits
    above: whether `lowest` itself is excluded
    infinite: whether an infinite number is allowed
    """

    lowest: float = -math.inf
    highest: float = math.inf
    above: bool = False
    infinite: bool = False

    def __str__(self) -> str:
        """Return the requirement in words, for example "a finite number above 0"."""
        form = "a number" if self.infinite else "a finite number"
        if self.lowest > -math.inf:
            lowest = f"{self.lowest:g}"
            form += f" above {lowest}" if self.above else f" of at least {lowest}"
        return form if self.highest == math.inf else f"{form}, at most {self.highest:g}"

    def of(self, value: Any) -> float | None:
        """Return the value as a float, or None if it is not a number within the declared limits."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return None
        try:
            number = float(value)
        except OverflowError:  # integers in TOML may exceed the range of floats
            return None
        is_within = self.lowest <= number <= self.highest  # False for nan
        is_excluded = self.above and number == self.lowest
        is_permitted = is_within and not is_excluded and (self.infinite or math.isfinite(number))
        return number if is_permitted else None


NUMBER = Number()
POSITIVE = Number(0.0, above=True)


def checked(where: str, value: Any, declared: Any, entry: str = "") -> Any:
    """Return a value of a user's file, with numbers converted to floats.

    where: the file, for the message
    value: the value
    declared: declaration of the value: a `Number`; `str` for any text; a tuple of permitted texts;
        a list with the declaration of all its items; for a table, name -> declaration of its entry,
        where "name*" is required, `str` stands for all other names, and ... permits these
        unchecked; or None for any value
    entry: name of the entry, for the message

    Raises BadInputError, with the file, the entry and the requirement, if the value does not match
    its declaration.
    """
    if isinstance(declared, Number):
        number = declared.of(value)
        if number is None:
            raise _refusal(where, entry, value, declared)
        return number
    if isinstance(declared, list):
        (of_items,) = declared
        if not isinstance(value, list):
            raise _refusal(where, entry, value, f"a list of {_words(of_items)}")
        return [
            checked(where, item, of_items, f"{entry}[{index}]") for index, item in enumerate(value)
        ]
    if isinstance(declared, dict):
        return _table(where, value, declared, entry)
    if declared is str and not isinstance(value, str):
        raise _refusal(where, entry, value, "a text in quotes")
    if isinstance(declared, tuple) and value not in declared:
        one_of = "one of " if len(declared) > 1 else ""
        raise _refusal(where, entry, value, one_of + ", ".join(declared))
    return value


def _refusal(where: str, entry: str, value: Any, wanted: object) -> BadInputError:
    """Return the error that an entry of a file has a wrong value."""
    return BadInputError(f"{where}: {shortened(entry)} is {shown(value)}; give {wanted}")


def _table(where: str, value: Any, declared: dict[Any, Any], entry: str) -> dict[str, Any]:
    """Return a table of a file, with each entry checked (`checked`)."""
    if not isinstance(value, dict):
        wanted = f"a table [{entry}]" if entry else "a table"
        raise _refusal(where, entry or "file", value, wanted)
    prefix = f"{entry}." if entry else ""
    # The key `str` declares the entries of all other names, and the key ... leaves them unchecked.
    takes_other_names = str in declared or ... in declared
    of_names = {  # a required name ends with *
        name.removesuffix("*"): kind for name, kind in declared.items() if isinstance(name, str)
    }
    entries = {}
    for name, item in value.items():
        if not (name in of_names or takes_other_names):
            unknown = shortened(ascii(name)[1:-1])
            raise BadInputError(
                f"{where}: unknown entry {prefix}{unknown}; {choice_of(name, of_names)}"
            )
        kind = of_names.get(name, declared.get(str))
        entries[name] = checked(where, item, kind, f"{prefix}{name}")
    for name, kind in of_names.items():
        if f"{name}*" in declared and name not in entries:
            what = "the table" if isinstance(kind, dict) else "this entry"
            raise BadInputError(f"{where}: {prefix}{name} is missing; add {what}")
    return entries


def _words(declared: Any) -> str:
    """Return what the items of a list with this declaration are called: "lists of numbers"."""
    if isinstance(declared, list):
        return f"lists of {_words(declared[0])}"
    return "numbers" if isinstance(declared, Number) else "names in quotes"


def read_named(what: str, name: str, packaged: Mapping[str, Path], declared: dict[Any, Any]) -> Any:
    """Return the entries of a TOML file that belongs to a package or to the user.

    what: kind of file, for messages
    name: a key of `packaged`, or the path of the user's file
    packaged: name -> path of a file of the package
    declared: declaration of the entries

    Raises BadInputError if the file cannot be read, is not valid TOML, or has invalid entries.
    """
    try:
        data = read_toml(packaged.get(name, name))
    except OSError as error:
        raise BadInputError(
            f"{name}: no {what} and no readable file of this name; choose from "
            f"{', '.join(packaged)}"
        ) from error
    return checked(name, data, declared)
