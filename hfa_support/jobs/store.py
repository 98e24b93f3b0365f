"""A large job and its results on disk: one Zarr group, written chunk by chunk, every chunk with a
CRC-32C.

The missing chunks are computed on the workers and written in order of arrival: a process on this
machine writes its chunk itself; from a cluster the rows come back and are written here. This
process alone marks a chunk as complete, after its data."""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder
from hfa_support.progress import Progress
from hfa_support.version import VERSION

#: Arguments of a job's function.
Task = tuple[Any, ...]
#: Array of flags, one a chunk: 1 when it is complete. Beside its chunks: the digest of the store's
#: description.
_DONE = "done"
_DIGEST = f"{_DONE}/digest"

#: A chunk of nothing but fill values has a file, too: without one it could not be told from one
#: that is lost.
_CONFIG = {"write_empty_chunks": True}


class Array(NamedTuple):
    """One array of a store: shape of one row, type, value of a row that is not yet computed.

    axes: names of the axes of a row. about: its attributes: units, long_name.
    """

    shape: tuple[int, ...]
    kind: str
    fill: Any
    axes: tuple[str, ...]
    about: Mapping[str, Any]


def described(meaning: str, units: str = "", units_of: str = "") -> dict[str, str]:
    """Attributes of an array. units_of: the labels that hold the unit of each entry, where they
    have their own."""
    about = {"long_name": meaning, "units": units, "units_of": units_of}
    return {name: text for name, text in about.items() if text}


@dataclass(frozen=True, eq=False)
class Layout:
    """What a store holds. schema: names its form and version. what: the job in one word, for
    messages.

    rows: N; row: the name of that axis. chunk: rows of a chunk. plan: JSON data that decides the
    results. arrays: name -> one array, (N, *shape). labels: name -> its axis and a text for each
    place of it; that of the same name as the axis are its coordinates. attributes: names and units
    of the columns."""

    schema: str
    what: str
    rows: int
    row: str
    chunk: int
    plan: Mapping[str, Any]
    arrays: Mapping[str, Array]
    labels: Mapping[str, tuple[str, Sequence[str]]]
    attributes: Mapping[str, Any]

    @property
    def identity(self) -> str:
        """A hash of the plan, the order of its entries included."""
        return hashlib.sha256(json.dumps(self.plan).encode()).hexdigest()


class Job(Protocol):
    """N rows that any process can compute, any part of them without the rest."""

    @property
    def layout(self) -> Layout:
        """What the store of the job holds."""

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """A pure function of a module, which workers import: (*task) -> the rows of the task, one
        array a name."""

    def task(self, start: int, stop: int) -> Task:
        """Arguments of the function for rows start .. stop - 1."""


class Store:
    """The store of one job: its arrays, and of each chunk whether it is complete. mode: "r", or
    "r+" to write."""

    def __init__(self, path: Path, mode: Any = "r") -> None:
        group: Any = _zarr().open_group(str(path), mode=mode)
        self.path, self.attributes = path, dict(group.attrs)
        self.chunk, self.rows = int(group.attrs["chunk"]), int(group.attrs["rows"])
        opened = {
            name: group[name].with_config(_CONFIG) for name in (*group.attrs["arrays"], _DONE)
        }
        self._done, self._arrays = opened.pop(_DONE), opened

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.rows // self.chunk)

    def end(self, number: int) -> int:
        """One beyond the last row of a chunk."""
        return min((number + 1) * self.chunk, self.rows)

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not complete."""
        return [number for number in range(self.chunks) if not self._is_complete(number)]

    def damaged(self) -> list[int]:
        """Numbers of the complete chunks that are not what was written. Reads all of them."""
        return [n for n in range(self.chunks) if self._is_complete(n) and not self._is_whole(n)]

    def write(self, number: int, result: Mapping[str, np.ndarray]) -> None:
        """Write the data of chunk `number`, one array a name; other processes may write other
        chunks meanwhile."""
        for name, array in self._arrays.items():
            array[self._span(number)] = np.ascontiguousarray(result[name], array.dtype)

    def complete(self, number: int) -> None:
        """Set the flag of a chunk whose data are written."""
        self._done[number] = 1

    def reopen(self, number: int) -> None:
        """Clear the flag of a chunk and remove its data: it is to be computed again."""
        self._done[number] = 0
        for name in self._arrays:
            self._file(name, number).unlink(missing_ok=True)

    def read(self, name: str, rows: slice = slice(None)) -> np.ndarray:
        """A slice of one array, without gaps. BadInputError when a complete chunk of it is not what
        was written."""
        start, stop, _ = rows.indices(self.rows)
        array, stop = self._arrays[name], max(start, stop)
        try:
            for number in range(start // self.chunk, -(-stop // self.chunk)):
                file = self._file(name, number)
                # Zarr reads a chunk without a file as one that was never written. An array without
                # entries has none.
                if array.size and self._is_complete(number) and not file.is_file():
                    raise FileNotFoundError(file)
            return np.asarray(array[start:stop])
        except (ValueError, FileNotFoundError) as error:  # a CRC-32C that differs is a ValueError
            raise BadInputError(
                f"{self.path}: {name} is damaged; compute it again with --resume"
            ) from error

    def _is_whole(self, number: int) -> bool:
        try:
            for name in self._arrays:
                self.read(name, self._span(number))
        except BadInputError:
            return False
        return True

    def _is_complete(self, number: int) -> bool:
        try:
            return bool(self._done[number] == 1)
        except ValueError:  # as in `read`
            return False

    def _file(self, name: str, number: int) -> Path:
        return self.path.joinpath(name, "c", str(number), *["0"] * (self._arrays[name].ndim - 1))

    def _span(self, number: int) -> slice:
        return slice(number * self.chunk, self.end(number))


def create_store(path: Path, layout: Layout, provenance: Mapping[str, Any] | None = None) -> Store:
    """A new store; BadInputError when something is there already. provenance: where it comes from,
    JSON data.

    It is made under a temporary name and renamed, so that it appears whole.
    """
    taken = BadInputError(f"{path} exists; continue it with --resume, or choose another name")
    if path.exists():
        raise taken
    with temporary_folder(path.parent) as folder:
        unfinished = folder / "store"
        _fill(_zarr().open_group(str(unfinished), mode="w"), layout, provenance)
        (unfinished / _DIGEST).write_text(_digest(unfinished), encoding="ascii")
        try:
            unfinished.rename(path)
        except OSError as error:
            raise (taken if path.exists() else error) from None  # another run was faster
    return Store(path, "r+")


def _fill(group: Any, layout: Layout, provenance: Mapping[str, Any] | None) -> None:
    from zarr.codecs import Crc32cCodec, ZstdCodec

    coded = {"compressors": [ZstdCodec(), Crc32cCodec()], "config": _CONFIG}
    rows = min(layout.chunk, layout.rows)
    for name, (shape, kind, fill, axes, about) in layout.arrays.items():
        named = {"dimension_names": (layout.row, *axes), "attributes": dict(about)}
        shapes = {
            "shape": (layout.rows, *shape),
            "chunks": (rows, *(max(size, 1) for size in shape)),
        }
        group.create_array(name, **shapes, dtype=kind, fill_value=fill, **named, **coded)
    labels = {name: (axis, words) for name, (axis, words) in layout.labels.items() if words}
    for name, (axis, words) in labels.items():
        listed = group.create_array(
            name, shape=(len(words),), dtype="str", dimension_names=(axis,), **coded
        )
        listed[:] = np.array(words, dtype=object)
    chunks = {
        "shape": (-(-layout.rows // layout.chunk),),
        "chunks": (1,),
        "dimension_names": ("chunk",),
    }
    group.create_array(_DONE, **chunks, dtype="uint8", fill_value=0, **coded)
    group.attrs.update(
        {
            **layout.attributes,
            "schema": layout.schema,
            "toolchain": VERSION,
            "identity": layout.identity,
            "plan": json.dumps(layout.plan),
            "rows": layout.rows,
            "chunk": layout.chunk,
            "arrays": list(layout.arrays),
            "labels": list(labels),
            **({} if provenance is None else {"provenance": dict(provenance)}),
        }
    )


def _digest(path: Path) -> str:
    """SHA-256 of all that says what the numbers mean: attributes, form of each array, names and
    units of the axes."""
    labels = json.loads((path / "zarr.json").read_bytes())["attributes"]["labels"]
    files = [
        path / "zarr.json",
        *sorted(path.glob("*/zarr.json")),
        *(path / name / "c" / "0" for name in labels),
    ]
    listed = [
        [str(file.relative_to(path)), hashlib.sha256(file.read_bytes()).hexdigest()]
        for file in files
    ]
    return hashlib.sha256(json.dumps(listed).encode()).hexdigest()


def open_store(path: Path, layout: Layout | None = None) -> Store:
    """An existing store, to be read, or with its layout to be continued.

    BadInputError when it is of another job or version, or its description is not what was written.
    """
    what = "store" if layout is None else f"{layout.what} store"
    _zarr()
    if not (path / _DIGEST).is_file():
        raise BadInputError(
            f"{path} is not a {what} of this version; start anew, without --resume, under another name"
        )
    try:
        whole = (path / _DIGEST).read_bytes() == _digest(path).encode()
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise BadInputError(
            f"{path} is damaged, its names, units or attributes are not those written; start anew"
        )
    if layout is None:
        return Store(path)
    store = Store(path, "r+")
    begun = store.attributes["toolchain"]
    if (store.attributes["schema"], store.attributes["identity"]) != (
        layout.schema,
        layout.identity,
    ):
        raise BadInputError(
            f"{path} belongs to another {layout.what}; give the same options, or another name"
        )
    if begun != VERSION:
        raise BadInputError(
            f"{path} was begun by version {begun} and this is {VERSION}: finish it there, or start anew"
        )
    return store


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise BadInputError(
            "a store needs Zarr; install it with `pip install .[distributed]`"
        ) from error
    return zarr


def stream(
    job: Job,
    path: Path,
    *,
    count: int = 1,
    scheduler: str | None = None,
    resume: bool = False,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Store:
    """Compute every row of the job that the store at `path` does not hold yet.

    count, scheduler: see `workers`. resume: continue an interrupted job, and compute damaged chunks
    again; else the store must be new. provenance: of a new store. progress is called with (chunks
    done, chunks in all), first at the start. The results do not depend on where they were computed.
    """
    from hfa_support.jobs.workers import workers

    layout, place = job.layout, path.resolve()
    with workers(count, scheduler) as run:
        store = open_store(place, layout) if resume else create_store(place, layout, provenance)
        damaged = store.damaged() if resume else []
        for number in damaged:
            store.reopen(number)
        if damaged:
            text = f"{path}: {len(damaged)} of {store.chunks} chunks were damaged and are computed again"
            warnings.warn(text, stacklevel=2)
        missing = store.missing()
        show = progress if progress is not None and missing else lambda *_: None
        show(
            store.chunks - len(missing), store.chunks
        )  # the first chunk may take a while: code is compiled
        here = place if scheduler is None else None
        tasks = (
            (
                number,
                (here, number, job.function, job.task(number * store.chunk, store.end(number))),
            )
            for number in missing
        )
        for done, (number, rows) in enumerate(
            run(_run_and_write, tasks), start=store.chunks - len(missing) + 1
        ):
            if rows is not None:
                store.write(number, rows)
            store.complete(number)
            show(done, store.chunks)
    return store


def _run_and_write(
    path: Path | None, number: int, function: Callable[..., Mapping[str, np.ndarray]], task: Task
) -> Mapping[str, np.ndarray] | None:
    """Compute one chunk and write it into the store at a path; without one return it. What a worker
    runs."""
    rows = function(*task)
    if path is None:
        return rows
    Store(path, "r+").write(number, rows)
    return None
