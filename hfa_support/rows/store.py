"""Results of many rows in a Zarr store, computed in chunks of rows.

A chunk is complete when all arrays contain it. A run that is killed loses only the chunks that are
being computed. Zarr notices a damaged chunk by its CRC-32C.

A store may come from an untrusted source. Before --resume opens it, its metadata are compared as
JSON with the metadata of a new store for the same request.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError, missing_package, on_one_line, shown, warn
from hfa_support.files import folder_written_whole, read_json, resolved
from hfa_support.origin import toolchain
from hfa_support.progress import Progress
from hfa_support.rows.workers import open_workers

#: Attributes of a store that belong to the run that created it, not to the job.
_ATTRIBUTES_OF_RUN = ("toolchain", "provenance")
_METADATA_FILE = "zarr.json"


class RowJob(NamedTuple):
    """Computation of N rows, in independent chunks.

    what: kind of the job for messages, as in "another sweep"
    row: name of the axis of rows, the first axis of each array
    template: `xarray.Dataset` of the arrays (`template_variable`), with names and units on the
        other axes. Its attributes contain everything that determines the results.
    function: (*arguments) -> arrays by name, including those of the template. Workers must be able
        to import the function.
    arguments: (start, stop) -> arguments of the function for rows start .. stop - 1.
    """

    what: str
    row: str
    template: Any
    function: Callable[..., Mapping[str, Any]]
    arguments: Callable[[int, int], tuple[Any, ...]]

    @property
    def rows(self) -> int:
        """Number of rows, N."""
        return int(self.template.sizes[self.row])

    @property
    def chunk(self) -> int:
        """Number of rows in each chunk. The last chunk may have fewer."""
        return int(self.template[self.arrays[0]].encoding["chunks"][0])

    @property
    def arrays(self) -> list[str]:
        """Names of the arrays that are computed."""
        variables = self.template.variables.items()
        return [str(name) for name, variable in variables if variable.dims[0] == self.row]

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.rows // self.chunk)

    def rows_of(self, number: int) -> slice:
        """Return the slice of row numbers in the chunk with this number."""
        first = number * self.chunk
        return slice(first, min(first + self.chunk, self.rows))


def template_variable(
    axes: tuple[str, ...],
    shape: tuple[int, ...],
    fill: Any,
    chunk: int,
    attributes: Mapping[str, Any],
) -> Any:
    """Return an `xarray.Variable` without memory for the template of a job.

    axes: names of the axes; the axis of rows is the first
    shape: length of each axis
    fill: value and type of entries that are not computed yet
    chunk: number of rows in a chunk
    attributes: units and description
    """
    _require_xarray()
    import xarray

    values = np.broadcast_to(np.asarray(fill), shape)
    encoding = {"fill_value": fill, "chunks": (chunk, *shape[1:])}
    return xarray.Variable(axes, values, attributes, encoding)


def fill_store(
    job: RowJob,
    path: Path,
    *,
    workers: int | str = 1,
    resume: bool = False,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Any:
    """Compute all rows that are missing in the store at `path`, and return the store.

    The result is an `xarray.Dataset`.

    workers: as in `open_workers`; the results do not depend on the workers
    resume: True to continue an interrupted job and recompute damaged chunks; False if the store
        does not exist
    provenance: provenance of a new store, as JSON data
    progress: called with (chunks done, total chunks), first at the start

    Raises BadInputError if the store exists and `resume` is False, or if `resume` is True and the
    store is missing, damaged, or of another job or version.
    """
    store = resolved(path)
    chunks = job.chunks
    with open_workers(workers) as run:
        if resume:
            _refuse_another(store, job)
            for unfinished in store.rglob("*.partial"):  # of an interrupted write
                unfinished.unlink(missing_ok=True)
            missing = _missing_chunks(store, job)
        else:
            _create(store, job, provenance)
            missing = list(range(chunks))
        done = chunks - len(missing)
        if progress is not None and missing:
            progress(done, chunks)  # the first chunk takes longer, because code is compiled
        # Processes on this machine write their chunks. A cluster returns the rows.
        target = None if isinstance(workers, str) else store
        tasks = ((number, _task(job, number, target)) for number in missing)
        for number, results in run(_compute_chunk, tasks):
            if results is not None:
                _write(store, job.rows_of(number), results)
            done += 1
            if progress is not None:
                progress(done, chunks)
    return open_store(path)


def open_store(path: Any) -> Any:
    """Return a store as `xarray.Dataset`. Its arrays are read when they are used."""
    _require_xarray()
    import xarray

    return xarray.open_zarr(path, consolidated=False, chunks=None, zarr_format=3)


def _task(job: RowJob, number: int, path: Path | None) -> tuple[Any, ...]:
    """Return the arguments of `_compute_chunk` for a chunk.

    path: store into which the worker writes the rows, or None if it returns them
    """
    rows = job.rows_of(number)
    return path, rows, job.arrays, job.function, job.arguments(rows.start, rows.stop)


def _compute_chunk(
    path: Path | None,
    rows: slice,
    names: list[str],
    function: Callable[..., Mapping[str, Any]],
    arguments: tuple[Any, ...],
) -> Mapping[str, Any] | None:
    """Compute the rows of a chunk, and write them into a store or, without a path, return them."""
    computed = function(*arguments)
    results = {name: computed[name] for name in names}
    if path is None:
        return results
    _write(path, rows, results)
    return None


def _write(path: Path, rows: slice, results: Mapping[str, Any]) -> None:
    """Write the rows of a chunk, while other processes may write other chunks."""
    group = _opened(path, "r+")
    for name, values in results.items():
        # A chunk of fill values is written too. Without a file it would count as missing.
        array = group[name].with_config({"write_empty_chunks": True})
        array[rows] = np.ascontiguousarray(values, array.dtype)


def _zarr() -> ModuleType:
    """Return Zarr, after removing its environment variables, which could change the format."""
    for name in [name for name in os.environ if name.startswith("ZARR_")]:
        del os.environ[name]
    import zarr

    return zarr


def _opened(path: Path, mode: Literal["r", "r+"]) -> Any:
    """Return the Zarr group of a store, opened for reading or also for writing."""
    return _zarr().open_group(str(path), mode=mode, zarr_format=3)


def _create(path: Path, job: RowJob, provenance: Mapping[str, Any] | None) -> None:
    """Create a store without results, which becomes visible when its metadata are complete.

    Raises BadInputError if something exists at the path, or the folder cannot be written.
    """
    if os.path.lexists(path):  # also a link to itself
        raise BadInputError(
            f"{path} already exists; continue this store with --resume, or give another path"
        )
    with folder_written_whole(path) as store:
        for name, content in _template(job, provenance).items():
            file = store / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(content.to_bytes())


def _template(job: RowJob, provenance: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the files of a store without results, name -> content: metadata, names and units."""
    from zarr.codecs import Crc32cCodec, ZstdCodec
    from zarr.storage import MemoryStore

    template = job.template.assign_attrs(toolchain=toolchain())
    if provenance is not None:
        template = template.assign_attrs(provenance=dict(provenance))
    codecs = {"compressors": (ZstdCodec(), Crc32cCodec())}
    encoding = {name: variable.encoding | codecs for name, variable in template.variables.items()}
    files: dict[str, Any] = {}
    # The results in the template are fill values, of which Zarr writes no chunk.
    template.to_zarr(MemoryStore(files), encoding=encoding, consolidated=False, zarr_format=3)
    return files


def _refuse_another(path: Path, job: RowJob) -> None:
    """Raise BadInputError unless the store at `path` belongs to this job and this version."""
    # The metadata are compared with those of a new store before any array is opened.
    _require_xarray()
    from zarr.storage import MemoryStore

    files = _template(job, None)
    expected = {
        name: _without_run(json.loads(content.to_bytes()))
        for name, content in files.items()
        if name.endswith(_METADATA_FILE)
    }
    attributes_of_job = expected[_METADATA_FILE]["attributes"]
    try:
        metadata = read_json(path / _METADATA_FILE)
        attributes = metadata["attributes"]
        if attributes["schema"] != attributes_of_job["schema"]:
            raise ValueError("another schema")
        begun = str(attributes["toolchain"])
        same_job = _without_run(metadata)["attributes"] == attributes_of_job
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a {job.what} store of this version, or is damaged; give another path, "
            "without --resume"
        ) from error
    if not same_job:
        raise BadInputError(
            f"{path} is the store of another {job.what}; give the options of that {job.what}, or "
            "another path"
        )
    if begun != toolchain():
        raise BadInputError(
            f"{path} was started by version {on_one_line(begun)}, but this is {toolchain()}; "
            "finish the store with the former version, or start a new store"
        )
    other = _differing_file(path, expected)
    if other:
        raise BadInputError(
            f"{path} is damaged or has another origin: {other} differs from the store of this "
            f"{job.what}; start a new store"
        )
    if not _same_labels(path, job.row, _labels(MemoryStore(files), job.row)):
        raise BadInputError(
            f"{path} is damaged: the names or units differ from the names or units of this "
            f"{job.what}; start a new store"
        )


def _without_run(metadata: dict[str, Any]) -> dict[str, Any]:
    """Return metadata without the attributes of the run that created the store; the others
    determine the results.
    """
    attributes = metadata["attributes"]
    kept = {key: attributes[key] for key in attributes if key not in _ATTRIBUTES_OF_RUN}
    return metadata | {"attributes": kept}


def _differing_file(path: Path, expected: Mapping[str, Any]) -> str:
    """Return the path of a file of a store that has other metadata or is a symbolic link; "the
    metadata of an array" if these cannot be read; "" if all is as expected.

    expected: path of a metadata file -> its content
    """
    if link := next(filter(Path.is_symlink, path.rglob("*")), None):
        return shown(str(link.relative_to(path)))
    for name, content in expected.items():
        try:
            stored = _without_run(read_json(path / name))
        except (OSError, ValueError, LookupError, TypeError, BadInputError):
            return "the metadata of an array"
        if stored != content:
            return name
    return ""


def _labels(store: Any, row: str) -> dict[str, list[Any]]:
    """Return array -> its entries, for each array of names or units, which has no axis of rows."""
    stored = open_store(store)
    return {
        str(name): variable.values.tolist()
        for name, variable in stored.variables.items()
        if variable.dims[0] != row
    }


def _same_labels(path: Path, row: str, expected: Mapping[str, list[Any]]) -> bool:
    """Return whether the names and units in a store can be read and are as expected."""
    try:
        return _labels(path, row) == expected
    except (OSError, ValueError, RuntimeError, MemoryError):  # a damaged chunk
        return False


def _missing_chunks(path: Path, job: RowJob) -> list[int]:
    """Return the numbers of the chunks that are missing or damaged in an array, with a warning of
    how many are damaged.
    """
    group = _opened(path, "r")
    missing = []
    damaged = 0
    for number in range(job.chunks):
        if not all(_is_written(path / name, group[name], number) for name in job.arrays):
            missing.append(number)
        elif not _is_intact(group, job.arrays, job.rows_of(number)):
            missing.append(number)
            damaged += 1
    if damaged:
        warn(f"{path}: {damaged} of {job.chunks} chunks were damaged and are computed again")
    return missing


def _is_intact(group: Any, names: list[str], rows: slice) -> bool:
    """Return whether the stored chunk of each array has its CRC-32C and can be read."""
    try:
        for name in names:
            group[name][rows]
    except (OSError, ValueError, RuntimeError, MemoryError):  # not the bytes of a chunk
        return False
    return True


def _is_written(folder: Path, array: Any, number: int) -> bool:
    """Return whether the file of an array's chunk exists."""
    indices = (number, *(0 for _ in array.shape[1:]))
    return (folder / array.metadata.encode_chunk_key(indices)).is_file()


def _require_xarray() -> None:
    """Raise BadInputError if xarray or Zarr is not installed."""
    try:
        import xarray  # noqa: F401

        _zarr()
    except ImportError as error:
        raise missing_package("a store requires", "xarray", "zarr", "distributed") from error
