"""Results of many rows in a Zarr store: xarray describes it, any process computes a chunk of it.

A chunk is complete when every array has it: Zarr writes a chunk whole or not at all. A run that is
killed loses the chunks in work, no more. A CRC-32C in each chunk tells when its numbers changed.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import temporary_folder
from hfa_support.progress import Progress
from hfa_support.version import VERSION
from hfa_support.workers import open_workers

#: Attributes of a store that are not the job's.
_OF_ONE_RUN = ("toolchain", "provenance")


class RowJob(NamedTuple):
    """N rows that any process can compute, any part of them without the others.

    what: the kind of job in messages, as in "another sweep".
    row: name of the axis of rows, the first axis of each array.
    template: `xarray.Dataset` of the arrays (`array_of_rows`), and of the names and units on their
        other axes. Its attributes say all that decides the results.
    function: of a module, so that workers can import it: (*arguments) -> arrays by name; the store
        takes those of the template.
    arguments: (start, stop) -> arguments of the function for rows start .. stop - 1.
    """

    what: str
    row: str
    template: Any
    function: Callable[..., Mapping[str, Any]]
    arguments: Callable[[int, int], tuple[Any, ...]]

    @property
    def rows(self) -> int:
        """N."""
        return int(self.template.sizes[self.row])

    @property
    def chunk(self) -> int:
        """Rows of a chunk; the last one may have fewer."""
        return int(self.template.chunksizes[self.row][0])

    @property
    def arrays(self) -> list[str]:
        """Names of the arrays that are computed."""
        variables = self.template.variables.items()
        return [str(name) for name, variable in variables if variable.dims[0] == self.row]

    def rows_of(self, number: int) -> slice:
        """The rows of a chunk."""
        first = number * self.chunk
        return slice(first, min(first + self.chunk, self.rows))


def array_of_rows(
    axes: tuple[str, ...],
    shape: tuple[int, ...],
    fill: Any,
    chunk: int,
    attributes: Mapping[str, Any],
) -> Any:
    """A lazy `xarray.Variable` for the template of a job.

    axes, shape: of the array, that of the rows first.
    fill: value and type of what is not computed yet.
    chunk: rows of a chunk.
    attributes: units and meaning.
    """
    _require_xarray()
    import dask.array
    import xarray

    kind = np.asarray(fill).dtype
    values = dask.array.full(shape, fill, dtype=kind, chunks=(chunk, *shape[1:]))
    return xarray.Variable(axes, values, attributes, {"fill_value": fill})


def fill_store(
    job: RowJob,
    path: Path,
    *,
    workers: int | str = 1,
    resume: bool = False,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Any:
    """Compute every row that the store at `path` does not hold yet; the store as `xarray.Dataset`.

    workers: see `open_workers`; the results do not depend on it.
    resume: continue an interrupted job and compute damaged chunks again; otherwise the store must
        be new.
    provenance: where a new store comes from, JSON data.
    progress: called with (chunks done, chunks in all), first at the start.

    BadInputError when the store exists, or is not one of this job and version.
    """
    store = path.resolve()
    chunks = -(-job.rows // job.chunk)
    with open_workers(workers) as run:
        if resume:
            _refuse_another(store, job)
            missing = _missing_chunks(store, job, chunks)
        else:
            _create(store, job, provenance)
            missing = list(range(chunks))
        done = chunks - len(missing)
        if progress is not None and missing:
            progress(done, chunks)  # the first chunk may take a while: code is compiled
        # Processes of this machine write their chunks; from a cluster the rows come back.
        target = None if isinstance(workers, str) else store
        tasks = ((number, _task(job, number, target)) for number in missing)
        for number, results in run(_compute_chunk, tasks):
            if results is not None:
                _write(store, job.rows_of(number), results)
            done += 1
            if progress is not None:
                progress(done, chunks)
    return open_store(path)


def open_store(path: Path) -> Any:
    """A store as `xarray.Dataset`, whose arrays are read when they are used."""
    _require_xarray()
    import xarray

    return xarray.open_zarr(path, consolidated=False, chunks=None)


def _task(job: RowJob, number: int, path: Path | None) -> tuple[Any, ...]:
    """Arguments of `_compute_chunk`."""
    rows = job.rows_of(number)
    return path, rows, job.arrays, job.function, job.arguments(rows.start, rows.stop)


def _compute_chunk(
    path: Path | None,
    rows: slice,
    names: list[str],
    function: Callable[..., Mapping[str, Any]],
    arguments: tuple[Any, ...],
) -> Mapping[str, Any] | None:
    """Compute the rows of a chunk and write them to the store at `path`; without a path return
    them. What a worker runs."""
    computed = function(*arguments)
    results = {name: computed[name] for name in names}
    if path is None:
        return results
    _write(path, rows, results)
    return None


def _write(path: Path, rows: slice, results: Mapping[str, Any]) -> None:
    """Write the rows of one chunk; other processes may write other chunks meanwhile."""
    import zarr

    group: Any = zarr.open_group(str(path), mode="r+")
    for name, values in results.items():
        # A chunk of fill values is written too: without a file it would count as missing.
        array = group[name].with_config({"write_empty_chunks": True})
        array[rows] = np.ascontiguousarray(values, array.dtype)


def _create(path: Path, job: RowJob, provenance: Mapping[str, Any] | None) -> None:
    """A new store without results; BadInputError when something is there already.

    It is made under a temporary name and renamed, so that it appears whole.
    """
    from zarr.codecs import Crc32cCodec, ZstdCodec

    taken = BadInputError(f"{path} exists; continue it with --resume, or choose another name")
    if path.exists():
        raise taken
    template = job.template.assign_attrs(toolchain=VERSION)
    if provenance is not None:
        template = template.assign_attrs(provenance=dict(provenance))
    codecs = {"compressors": (ZstdCodec(), Crc32cCodec())}
    encoding = {name: variable.encoding | codecs for name, variable in template.variables.items()}
    with temporary_folder(path.parent) as folder:
        template.to_zarr(
            folder / "store", encoding=encoding, compute=False, consolidated=False, zarr_format=3
        )
        try:
            (folder / "store").rename(path)
        except OSError as error:
            raise (taken if path.exists() else error) from None  # another run was faster


def _refuse_another(path: Path, job: RowJob) -> None:
    """BadInputError unless the store at `path` is of this job and of this version."""
    try:
        stored = open_store(path)
        if stored.attrs["schema"] != job.template.attrs["schema"]:
            raise ValueError("another schema")
        begun = stored.attrs["toolchain"]
        same_job = _attributes(stored) == _attributes(job.template)
        same_arrays = _axes(stored, job.row) == _axes(job.template, job.row)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BadInputError(
            f"{path} is not a {job.what} store of this version, or damaged; start anew, without "
            "--resume, under another name"
        ) from error
    if not same_job:
        raise BadInputError(
            f"{path} belongs to another {job.what}; give the same options, or another name"
        )
    if begun != VERSION:
        raise BadInputError(
            f"{path} was begun by version {begun} and this is {VERSION}: finish it there, or start "
            "anew"
        )
    if not same_arrays:
        raise BadInputError(
            f"{path} is damaged: its names or units are not those of this {job.what}; start anew"
        )


def _attributes(dataset: Any) -> str:
    """The attributes that decide the results, as JSON: the order of the variables counts."""
    compared = {key: value for key, value in dataset.attrs.items() if key not in _OF_ONE_RUN}
    return json.dumps(compared)


def _axes(dataset: Any, row: str) -> dict[str, str]:
    """Of each array its axes, shape and attributes, and of names and units the words, as JSON."""
    axes = {}
    for name, variable in dataset.variables.items():
        words = None if variable.dims[0] == row else variable.values.tolist()
        axes[str(name)] = json.dumps([variable.dims, variable.shape, dict(variable.attrs), words])
    return axes


def _missing_chunks(path: Path, job: RowJob, chunks: int) -> list[int]:
    """Numbers of the chunks that some array does not have, or whose numbers changed since they
    were written; a warning counts the latter."""
    import zarr

    group: Any = zarr.open_group(str(path), mode="r")
    missing = []
    damaged = 0
    for number in range(chunks):
        if not all(_is_written(path / name, group[name], number) for name in job.arrays):
            missing.append(number)
            continue
        try:
            for name in job.arrays:
                group[name][job.rows_of(number)]
        except ValueError:  # of a CRC-32C that differs
            missing.append(number)
            damaged += 1
    if damaged:
        warnings.warn(
            f"{path}: {damaged} of {chunks} chunks were damaged and are computed again",
            stacklevel=3,
        )
    return missing


def _is_written(folder: Path, array: Any, number: int) -> bool:
    """Whether an array has a chunk, which spans its other axes."""
    indices = (number, *(0 for _ in array.shape[1:]))
    return (folder / array.metadata.encode_chunk_key(indices)).is_file()


def _require_xarray() -> None:
    try:
        import dask.array  # noqa: F401
        import xarray  # noqa: F401
        import zarr  # noqa: F401
    except ImportError as error:
        raise BadInputError(
            "a store needs xarray, Dask and Zarr; install them with `pip install .[distributed]`"
        ) from error
