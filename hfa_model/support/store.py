"""Results of a large job on disk: one Zarr group, written chunk by chunk.

Zarr rather than Parquet, because the results are stacked matrices: A of a sweep is an (N, 7, 7) array here, and would
be 49 columns there; any slice of it loads without the rest.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np

from hfa_model.support.errors import BadInputError
from hfa_model.support.version import toolchain_version


class Array(NamedTuple):
    """One array of a store: shape of one row, type, value of a row that is not yet computed."""

    shape: tuple[int, ...]
    kind: str
    fill: Any


@dataclass(frozen=True, eq=False)
class Layout:
    """What a store holds. schema: names its form and version. what: the job in one word, for messages.

    rows: N. chunk: rows of a chunk. plan: JSON data that decides the results; identity: a hash of it.
    arrays: name -> one array, (N, *shape). attributes: names and units of the columns.
    """

    schema: str
    what: str
    rows: int
    chunk: int
    plan: Mapping[str, Any]
    identity: str
    arrays: Mapping[str, Array]
    attributes: Mapping[str, Any]


class Store:
    """The store of one job: its arrays, and `done`, which says of each chunk whether it is complete."""

    def __init__(self, group: Any) -> None:
        self._group = group
        self.chunk = int(group.attrs["chunk"])

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not complete."""
        return np.flatnonzero(self._group["done"][:] == 0).tolist()

    def write(self, number: int, result: Mapping[str, np.ndarray]) -> None:
        """Write the data of chunk `number`, one array a name; other processes may write other chunks meanwhile."""
        for name, values in result.items():
            self._group[name][number * self.chunk : number * self.chunk + len(values)] = values

    def complete(self, number: int) -> None:
        """Set the flag of a chunk whose data are written."""
        self._group["done"][number] = 1

    @contextmanager
    def session(self) -> Iterator[str]:
        """A mark that this store bears while the block runs, and no copy of it elsewhere: workers know it by that."""
        mark = uuid4().hex
        self._group.attrs["session"] = mark
        try:
            yield mark
        finally:
            del self._group.attrs["session"]

    def read(self, name: str, rows: slice = slice(None)) -> np.ndarray:
        """A slice of one array."""
        return np.asarray(self._group[name][rows])


def create_store(path: Path, layout: Layout) -> Store:
    """A new store; BadInputError when something is there already."""
    zarr = _zarr()
    if path.exists():
        raise BadInputError(f"{path} exists; continue it with --resume, or choose another name")
    group = zarr.open_group(str(path), mode="w")
    rows = min(layout.chunk, layout.rows)
    for name, (shape, kind, fill) in layout.arrays.items():
        group.create_array(name, shape=(layout.rows, *shape), chunks=(rows, *shape), dtype=kind, fill_value=fill)
    chunks = -(-layout.rows // layout.chunk)
    group.create_array("done", shape=(chunks,), chunks=(1,), dtype="uint8", fill_value=0)
    known = {"identity": layout.identity, "plan": json.dumps(layout.plan), "chunk": layout.chunk, **layout.attributes}
    group.attrs.update({"schema": layout.schema, "toolchain": toolchain_version(), **known})
    return Store(group)


def open_store(path: Path, layout: Layout | None = None) -> Store:
    """An existing store, to be read, or with its layout to be continued; BadInputError when it is of another job."""
    zarr = _zarr()
    what = "store" if layout is None else f"{layout.what} store"
    try:
        group = zarr.open_group(str(path), mode="r" if layout is None else "r+")
        attributes = dict(group.attrs)
    except (OSError, ValueError, KeyError) as error:
        raise BadInputError(f"{path} is not a {what}; start it without --resume") from error
    if layout is None:
        if "identity" not in attributes:
            raise BadInputError(f"{path} is not a {what} of this project")
        return Store(group)
    if attributes.get("schema") != layout.schema:
        raise BadInputError(f"{path} is not a {what} of schema {layout.schema}")
    if attributes["identity"] != layout.identity:
        raise BadInputError(f"{path} belongs to another {layout.what}; give the same options, or another name")
    begun, own = attributes.get("toolchain"), toolchain_version()
    if begun != own:
        raise BadInputError(f"{path} was begun by version {begun} and this is {own}: finish it there, or start anew")
    return Store(group)


def store_in_sight(path: Path, mark: str) -> Store | None:
    """The store of a session to write into, or None where this process does not see it."""
    try:
        import zarr

        group = zarr.open_group(str(path), mode="r+")
    except (ImportError, OSError, ValueError, KeyError):
        return None
    return Store(group) if group.attrs.get("session") == mark else None


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise BadInputError("a store needs Zarr; install it with `pip install .[distributed]`") from error
    return zarr
