"""Origin of a result: the code that computed it, and all of which it was computed.

It is the key of stores, certificates, workers and caches.
"""

from __future__ import annotations

import time
from functools import cache, cached_property
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType, MethodType

from hfa_support.version import VERSION

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    import casadi as ca

#: Packages of the distribution, of which extensions may be missing.
PACKAGES = (
    *("controller", "hfa", "hfa_aircraft", "hfa_model", "hfa_support", "trim", "verification"),
    *("hfa_daveml", "hfa_flight", "hfa_fmu", "hfa_identify", "hfa_jsbsim", "hfa_page", "hfa_prove"),
)
#: Kinds of files that decide results. Line ends of texts and other files, as an editor's copies, do
#: not.
_SOURCES = (".py", ".toml", ".json", ".csv", ".in", ".c", ".m")
#: Distributions whose versions may change a number.
_NUMERICAL = ("casadi", "numpy", "python-flint", "scipy")
#: Time before which the modules of this process were on disk, ns.
_BEGAN = time.time_ns()


@cache
def _sources() -> tuple[list[Path], str]:
    """Return the source files, and a hash of their names and contents."""
    import hashlib

    digest, files = hashlib.sha256(), []
    for package in filter(None, map(find_spec, PACKAGES)):
        top = Path(str(package.origin)).parent
        for file in sorted(top.rglob("*.*")):
            if file.suffix in _SOURCES and file.name[0] != "." and file.is_file():
                content = file.read_bytes().replace(b"\r\n", b"\n")
                name = file.relative_to(top.parent).as_posix()
                digest.update(f"{name} {len(content)}\n".encode() + content)
                files.append(file)
    return files, digest.hexdigest()[:12]


@cache
def _of_this_process() -> str:
    """Return a text that is unlike that of any other process."""
    from uuid import uuid4

    return uuid4().hex[:12]


def _is_changed(file: Path) -> bool:
    """Return whether a file is not as it was when this process began."""
    try:
        found = file.stat()
    except OSError:
        return True
    return max(found.st_mtime_ns, found.st_ctime_ns) > _BEGAN


def code() -> str:
    """Return the version with a hash of the loaded sources, "0.4.0+1f3c5a7b9d0e".

    After a change of the files, a process that began before runs code of both: its results are
    unlike those of any other, "0.4.0+changed.1f3c5a7b9d0e". The files are read when the process
    first asks, in about 30 ms.
    """
    files, digest = _sources()
    if any(map(_is_changed, files)):
        digest = f"changed.{_of_this_process()}"
    return f"{VERSION}+{digest}"


@cache
def _libraries() -> str:
    """Return the versions of the numerical libraries, and of packages with entry points of ours."""
    from importlib.metadata import entry_points, version

    from hfa_support.entry_points import AIRCRAFT, COMMANDS, CRITICS

    versions = {name: version(name) for name in _NUMERICAL}
    for group in (AIRCRAFT, COMMANDS, CRITICS):
        for entry in entry_points(group=group):
            if entry.dist is not None and entry.module.partition(".")[0] not in PACKAGES:
                versions[entry.dist.name] = entry.dist.version
    return ", ".join(f"{name} {versions[name]}" for name in sorted(versions))


def toolchain() -> str:
    """Return what computes here: `code`, the numerical libraries, and packages of plug-ins."""
    return f"{code()} ({_libraries()})"


def fingerprint(value: Any) -> str:
    """Return a hash of a value, equal in all processes for values with equal parts.

    Parts are the compared fields with which a dataclass is made, the arguments to which an object
    reduces itself for copies, the attributes of other objects of this program, the instructions of
    CasADi functions, and the functions of this program with what they enclose. A function of the
    user is unlike any in another process.
    """
    import hashlib

    digest = hashlib.sha256()
    for part in _parts(value):
        digest.update(f"{len(part)} {part};".encode())
    return digest.hexdigest()


class Identified:
    """Base class of dataclasses (`eq=False`) that are equal if their compared fields are."""

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all compared fields: a new one decides results unless it says otherwise."""
        return fingerprint([type(self), *_compared(self)])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Identified) and self.fingerprint == other.fingerprint

    def __hash__(self) -> int:
        return hash(self.fingerprint)


def _compared(value: Any) -> list[tuple[str, Any]]:
    """Return the fields of a dataclass that decide results, (name, value) each."""
    from dataclasses import fields

    names = [each.name for each in fields(value) if each.compare and each.init]
    return [(name, getattr(value, name)) for name in names]


def _parts(value: Any) -> Iterator[str]:
    """Yield texts that tell a value from all others."""
    if value is None or isinstance(value, (str, bool)):
        yield repr(value)
    elif isinstance(value, (int, float, complex)):
        yield repr(int(value) if isinstance(value, float) and value.is_integer() else value)
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}"
    elif hasattr(value, "fingerprint"):  # computed once
        yield value.fingerprint
    else:
        yield type(value).__qualname__
        inside = _inside(value)
        yield inside if isinstance(inside, str) else str(len(inside))
        for part in () if isinstance(inside, str) else inside:
            yield from _parts(part)


def _inside(value: Any) -> Any:
    """Return the parts of an object, or a text that tells it from others of its type."""
    from collections.abc import Mapping
    from dataclasses import is_dataclass
    from enum import Enum
    from functools import partial

    import casadi as ca
    import numpy as np

    kind = type(value)
    if isinstance(value, (np.ndarray, np.generic)):
        array = np.asarray(value)
        content = array.tobytes().hex() if array.dtype.kind in "fc" else array.ravel().tolist()
        return [array.shape, content]
    if isinstance(value, Mapping):
        return [*value.items()]
    if isinstance(value, (set, frozenset)):
        return sorted(map(fingerprint, value))
    if isinstance(value, (list, tuple)):
        return value
    if isinstance(value, (Enum, Path, bytes)):
        return str(value)
    if isinstance(value, partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, MethodType):
        return [value.__name__, value.__self__]
    if isinstance(value, ca.Function):
        return value.name() + instructions(value)
    if is_dataclass(value):
        return _compared(value)
    if not _is_ours(getattr(value, "__module__", "")):
        return _unlike_any_other(value)
    if isinstance(value, FunctionType):
        enclosed = [cell.cell_contents for cell in value.__closure__ or ()]
        name = f"{value.__module__}.{value.__qualname__} {value.__code__.co_firstlineno}"
        return [name, enclosed, value.__defaults__, value.__kwdefaults__]
    if kind.__reduce__ is not object.__reduce__:
        return value.__reduce__()
    return sorted(vars(value).items())


def instructions(function: ca.Function, of_call: Callable[[ca.Function], str] | None = None) -> str:
    """Return a hash of the instructions of a CasADi function and of all digits of its constants.

    of_call: text of a function that it calls, such as a table, by default its serialized form
    """
    import hashlib

    import casadi as ca

    if not function.is_a("SXFunction"):
        if not function.is_a("MXFunction") or function.find_functions():
            return hashlib.sha256(_of_call(function).encode()).hexdigest()
        function = function.expand()
    hashed = hashlib.sha256()
    for index in range(function.n_instructions()):
        operation = function.instruction_id(index)
        places = (*function.instruction_input(index), -1, *function.instruction_output(index))
        content = ""
        if operation == ca.OP_CONST:
            content = float(function.instruction_constant(index)).hex()
        elif operation == ca.OP_CALL:
            called = function.instructions_sx()[index].which_function()
            content = (of_call or _of_call)(called)
        hashed.update(f"{operation} {places} {content};".encode())
    return hashed.hexdigest()


def _of_call(called: ca.Function) -> str:
    """Return the serialized form of a function, or a text unlike others of one that calls Python.

    Of a table, CasADi adds derivatives to this form when they are computed.
    """
    try:
        return str(called.serialize())
    except RuntimeError:
        return _unlike_any_other(called)


def _is_ours(module: str) -> bool:
    """Return whether a module is one of this program, so that `code` covers it."""
    return module.partition(".")[0] in PACKAGES


def _unlike_any_other(value: Any) -> str:
    """Return a text that is that of this object alone."""
    kept = _NAMED.setdefault(id(value), (value, len(_NAMED)))
    return f"{_of_this_process()}.{kept[1]}"


#: Objects without parts, by their addresses, which stay theirs.
_NAMED: dict[int, tuple[Any, int]] = {}
