"""Results of a large job on disk: one Zarr group, written chunk by chunk, each chunk with a checksum.

Zarr rather than Parquet, because the results are stacked matrices: A of a sweep is an (N, 7, 7) array here, and would
be 49 columns there; any slice of it loads without the rest.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.jobs.interrupts import held_back
from hfa_support.jobs.layout import Layout
from hfa_support.temporary import lock, temporary_folder
from hfa_support.version import toolchain_version

#: Whether a chunk is complete, (chunks,), and a checksum of each of its arrays, (chunks, arrays).
_DONE, _CHECKSUMS = "done", "checksums"
_UNREADABLE = 255


class Store:
    """The store of one job: its arrays, and of each chunk whether it is complete and what its checksums are."""

    def __init__(self, group: Any, path: Path) -> None:
        self._group, self._path = group, path
        self.chunk, self.rows = int(group.attrs["chunk"]), int(group.attrs["rows"])
        self._arrays = {str(name): group[name] for name in group.attrs["arrays"]}
        self._done, self._checksums = group[_DONE], group[_CHECKSUMS]

    @property
    def arrays(self) -> dict[str, Any]:
        """Those of the results, and those that say which of their chunks are whole."""
        return {**self._arrays, _DONE: self._done, _CHECKSUMS: self._checksums}

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.rows // self.chunk)

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not complete."""
        return np.flatnonzero(self._flags(0, self.chunks) != 1).tolist()

    def damaged(self) -> list[int]:
        """Numbers of the chunks that are not what was written, or of which that cannot be said. Reads all of them."""
        flags = self._flags(0, self.chunks)
        return [number for number, flag in enumerate(flags) if flag and not (flag == 1 and self._holds(number))]

    @held_back()
    def write(self, number: int, result: Mapping[str, np.ndarray]) -> list[int]:
        """Write the data of chunk `number`, one array a name; other processes may write other chunks meanwhile.

        Returns their checksums, for `complete`.
        """
        checksums = []
        for name, array in self._arrays.items():
            values = np.ascontiguousarray(result[name], array.dtype)
            array[self._span(number)] = values
            checksums.append(checksum(values))
        return checksums

    @held_back()
    def complete(self, number: int, checksums: list[int]) -> None:
        """Set the checksums and then the flag of a chunk whose data are written."""
        self._checksums[number] = checksums
        self._done[number] = 1

    @held_back()
    def reopen(self, number: int) -> None:
        """Take the flag of a chunk back: it is to be computed again."""
        self._done[number] = 0

    @contextmanager
    def session(self) -> Iterator[str]:
        """A mark that this store alone bears while the block runs, for workers; BadInputError: another run has it."""
        mark = uuid4().hex
        with lock(self._path) as alone:
            if not alone:
                raise BadInputError(f"{self._path}: another run writes into it; wait for its end, or end it")
            with held_back():
                self._group.attrs["session"] = mark
            try:
                yield mark
            finally:
                with held_back():
                    del self._group.attrs["session"]

    def read(self, name: str, rows: slice = slice(None)) -> np.ndarray:
        """A slice of one array, without gaps. BadInputError when a complete chunk of it is not what was written."""
        array = self._arrays[name]
        start, stop, step = rows.indices(self.rows)
        if step != 1:
            raise ValueError("the rows of a store are read one after the other")
        first, last = start // self.chunk, -(-stop // self.chunk)
        flags, begin = self._flags(first, last), first * self.chunk
        parts = [self._part(name, number, flags[number - first] == 1) for number in range(first, last)]
        whole = np.concatenate([np.empty((0, *array.shape[1:]), array.dtype), *parts])
        return whole[start - begin : stop - begin]

    @held_back()
    def _part(self, name: str, number: int, complete: bool) -> np.ndarray:
        try:
            values = np.asarray(self._arrays[name][self._span(number)])
            expected = self._checksums[number, list(self._arrays).index(name)] if complete else None
        except Exception as error:  # Zarr and its codecs raise nearly anything
            raise self._damage(name, number) from error
        if expected is not None and checksum(values) != expected:
            raise self._damage(name, number)
        return values

    def _holds(self, number: int) -> bool:
        try:
            for name in self._arrays:
                self._part(name, number, complete=True)
        except BadInputError:
            return False
        return True

    def _damage(self, name: str, number: int) -> BadInputError:
        return BadInputError(f"{self._path}: {name} is damaged in chunk {number}; compute it again with --resume")

    def _span(self, number: int) -> slice:
        return slice(number * self.chunk, min((number + 1) * self.chunk, self.rows))

    @held_back()
    def _flags(self, first: int, last: int) -> np.ndarray:
        """`done` of chunks first .. last - 1: 0, 1, or anything else where it is damaged."""
        try:
            return np.asarray(self._done[first:last])
        except Exception:  # whatever Zarr and its codecs make of a damaged flag: it is told as unreadable, one by one
            if last - first == 1:
                return np.array([_UNREADABLE], dtype=np.uint8)
        return np.concatenate([self._flags(number, number + 1) for number in range(first, last)])


def checksum(values: np.ndarray) -> int:
    """CRC-32 of an array's bytes; every nan counts as the same, as Zarr does not store a chunk of nothing else."""
    flat = np.ascontiguousarray(values).reshape(-1)
    numbers = flat.view(float) if flat.dtype.kind == "c" else flat
    if numbers.dtype.kind == "f" and np.isnan(numbers).any():
        numbers = np.where(np.isnan(numbers), np.nan, numbers)
    return zlib.crc32(numbers.view(np.uint8).data)


@held_back()
def create_store(path: Path, layout: Layout, provenance: Mapping[str, Any] | None = None) -> Store:
    """A new store; BadInputError when something is there already. provenance: where it comes from, JSON data."""
    zarr = _zarr()
    _refuse_existing(path)
    # Beside it and renamed: who is killed here leaves no store that can be neither continued nor begun.
    with temporary_folder(path.parent, f".{path.name}.") as folder:
        unfinished = folder / "store"
        _fill(zarr.open_group(str(unfinished), mode="w"), layout, provenance)
        try:
            unfinished.rename(path)
        except OSError:
            _refuse_existing(path)  # another run was faster
            raise
    return Store(zarr.open_group(str(path), mode="r+"), path)


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise BadInputError(f"{path} exists; continue it with --resume, or choose another name")


def _fill(group: Any, layout: Layout, provenance: Mapping[str, Any] | None) -> None:
    rows = min(layout.chunk, layout.rows)
    for name, (shape, kind, fill, axes, about) in layout.arrays.items():
        named = {"dimension_names": (layout.row, *axes), "attributes": dict(about)}
        shapes = {"shape": (layout.rows, *shape), "chunks": (rows, *(max(size, 1) for size in shape))}
        group.create_array(name, **shapes, dtype=kind, fill_value=fill, **named)
    for name, (axis, words) in layout.labels.items():
        if words:
            listed = group.create_array(name, shape=(len(words),), dtype="str", dimension_names=(axis,))
            listed[:] = np.array(words, dtype=object)
    chunks, names = -(-layout.rows // layout.chunk), list(layout.arrays)
    for name, kind, shape, axes in ((_CHECKSUMS, "uint32", (len(names),), ("array",)), (_DONE, "uint8", (), ())):
        shapes = {"shape": (chunks, *shape), "chunks": (1, *shape)}
        group.create_array(name, **shapes, dtype=kind, fill_value=0, dimension_names=("chunk", *axes))
    size = {"rows": layout.rows, "chunk": layout.chunk, "arrays": names}
    known = {"identity": layout.identity, "plan": json.dumps(layout.plan), **size, **layout.attributes}
    known |= {"schema": layout.schema, "toolchain": toolchain_version()}
    known |= {} if provenance is None else {"provenance": dict(provenance)}
    made = {name: group[name] for name in (*names, _CHECKSUMS, _DONE)}
    group.attrs.update(known | {"checksum": _checksum_of(known, made)})


@held_back()
def open_store(path: Path, layout: Layout | None = None) -> Store:
    """An existing store, to be read, or with its layout to be continued.

    BadInputError when it is of another job, or damaged beyond what computing chunks again would repair.
    """
    zarr = _zarr()
    what = "store" if layout is None else f"{layout.what} store"
    try:
        group = zarr.open_group(str(path), mode="r" if layout is None else "r+")
        attributes = dict(group.attrs)
    except Exception as error:  # no store at all, or what Zarr makes of damaged JSON
        raise BadInputError(f"{path} is not a {what}; start it without --resume") from error
    if "identity" not in attributes:
        raise BadInputError(f"{path} is not a {what} of this project")
    if "checksum" not in attributes:
        raise BadInputError(f"{path} has no checksums: it is damaged or of an older version; compute it anew")
    known = {name: value for name, value in attributes.items() if name not in ("checksum", "session")}
    try:
        store = Store(group, path)
        whole = attributes["checksum"] == _checksum_of(known, store.arrays)
    except Exception as error:
        raise BadInputError(f"{path} is damaged, an array of it cannot be read; start anew") from error
    if not whole:
        raise BadInputError(
            f"{path} is damaged, its attributes or the forms of its arrays are not those that were written; start anew"
        )
    if layout is not None:
        _check_job(path, attributes, layout)
    return store


def _check_job(path: Path, attributes: Mapping[str, Any], layout: Layout) -> None:
    """Raise BadInputError unless the store is of this job and this version."""
    if attributes["schema"] != layout.schema:
        raise BadInputError(f"{path} is not a {layout.what} store of schema {layout.schema}")
    if attributes["identity"] != layout.identity:
        raise BadInputError(f"{path} belongs to another {layout.what}; give the same options, or another name")
    begun, own = attributes["toolchain"], toolchain_version()
    if begun != own:
        raise BadInputError(f"{path} was begun by version {begun} and this is {own}: finish it there, or start anew")


def _checksum_of(attributes: Mapping[str, Any], arrays: Mapping[str, Any]) -> int:
    """CRC-32 of the attributes and of what decides how the chunks of each array are read."""
    forms = {
        name: [array.shape, array.chunks, str(array.dtype), str(array.fill_value), array.metadata.dimension_names]
        for name, array in arrays.items()
    }
    return zlib.crc32(json.dumps([attributes, forms], sort_keys=True).encode())


def store_in_sight(path: Path, mark: str) -> Store | None:
    """The store of a session to write into, or None where this process does not see it."""
    try:
        import zarr

        group = zarr.open_group(str(path), mode="r+")
    except (ImportError, OSError, ValueError, KeyError):
        return None
    return Store(group, path) if group.attrs.get("session") == mark else None


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise BadInputError("a store needs Zarr; install it with `pip install .[distributed]`") from error
    return zarr
