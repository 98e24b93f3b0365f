"""The results of a large sweep on disk: one Zarr group, written chunk by chunk.

Zarr rather than Parquet, because the results are stacked matrices: A is an (N, 7, 7) array here, and would be
49 columns there; any slice of it loads without the rest.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.errors import BadInputError
from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES
from trim.chunk import STATUS, Chunk
from trim.plan import SweepPlan

SCHEMA = "hfa.sweep-store/1"

_N, _M = len(STATES), len(INPUTS)
#: Array -> (shape of one point, type, value of a point not yet computed).
_ARRAYS: dict[str, tuple[tuple[int, ...], str, Any]] = {
    "status": ((), "int8", -1),
    "limiting": ((), "int8", -1),
    "states": ((_N,), "float64", np.nan),
    "inputs": ((_M,), "float64", np.nan),
    "A": ((_N, _N), "float64", np.nan),
    "B": ((_N, _M), "float64", np.nan),
    "eigenvalues": ((_N,), "complex128", complex(np.nan, np.nan)),
}


class SweepStore:
    """The store of one plan; `values` holds the varied variables, `done` which chunks are complete."""

    def __init__(self, group: Any) -> None:
        self._group = group
        self.chunk = int(group.attrs["chunk"])

    def missing(self) -> list[int]:
        """Numbers of the chunks that are not complete."""
        return np.flatnonzero(self._group["done"][:] == 0).tolist()

    def write(self, number: int, values: np.ndarray, result: Chunk) -> None:
        """Write chunk `number`: its data, and only then its flag."""
        rows = slice(number * self.chunk, number * self.chunk + len(values))
        self._group["values"][rows] = values
        for name in _ARRAYS:
            self._group[name][rows] = getattr(result, name)
        self._group["done"][number] = 1

    def read(self, name: str, rows: slice = slice(None)) -> np.ndarray:
        """A slice of one array."""
        return np.asarray(self._group[name][rows])

    def counts(self) -> dict[str, int]:
        """Status -> number of points, and "missing" for those not computed yet."""
        status = self._group["status"]
        totals = np.zeros(len(STATUS) + 1, dtype=int)
        for start in range(0, status.shape[0], self.chunk):
            totals += np.bincount(status[start : start + self.chunk] + 1, minlength=len(totals))
        return dict(zip(("missing", *STATUS), totals.tolist(), strict=True))


def create_store(path: Path, plan: SweepPlan, chunk: int) -> SweepStore:
    """A new store for all points of a plan; BadInputError when something is there already."""
    zarr = _zarr()
    if path.exists():
        raise BadInputError(f"{path} exists; continue it with --resume, or choose another name")
    group = zarr.open_group(str(path), mode="w")
    count = plan.count
    shapes: Iterable[tuple[str, tuple[tuple[int, ...], str, Any]]] = (
        ("values", ((len(plan.variables),), "float64", np.nan)),
        *_ARRAYS.items(),
    )
    for name, (shape, kind, fill) in shapes:
        group.create_array(name, shape=(count, *shape), chunks=(min(chunk, count), *shape), dtype=kind, fill_value=fill)
    chunks = -(-count // chunk)
    group.create_array("done", shape=(chunks,), chunks=(1,), dtype="uint8", fill_value=0)
    group.attrs.update(_attributes(plan, chunk))
    return SweepStore(group)


def open_store(path: Path, plan: SweepPlan | None = None) -> SweepStore:
    """An existing store; with a plan, BadInputError when it was made for another."""
    zarr = _zarr()
    try:
        group = zarr.open_group(str(path), mode="r" if plan is None else "r+")
        attributes = dict(group.attrs)
    except (OSError, ValueError, KeyError) as error:
        raise BadInputError(f"{path} is not a sweep store; start it without --resume") from error
    if attributes.get("schema") != SCHEMA:
        raise BadInputError(f"{path} is not a sweep store of schema {SCHEMA}")
    if plan is not None and attributes["identity"] != plan.identity:
        raise BadInputError(f"{path} belongs to another sweep; give the same options, or another name")
    return SweepStore(group)


def _attributes(plan: SweepPlan, chunk: int) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "identity": plan.identity,
        "plan": json.dumps(plan.to_dict()),
        "chunk": chunk,
        "variables": list(plan.variables),
        "variable_units": list(plan.units),
        "states": list(STATES),
        "state_units": list(STATE_UNITS),
        "inputs": list(INPUTS),
        "input_units": list(INPUT_UNITS),
        "status": list(STATUS),
        "limiting": list(STATES + INPUTS),
    }


def _zarr() -> Any:
    try:
        import zarr
    except ImportError as error:
        raise BadInputError("a sweep store needs Zarr; install it with `pip install .[distributed]`") from error
    return zarr
