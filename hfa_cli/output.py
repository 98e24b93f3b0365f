"""Where results go: standard output, or a file whose suffix chooses the format."""

from __future__ import annotations

import io
import json
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.support.errors import BadInputError
from hfa_model.support.files import write_text, written_whole
from hfa_model.support.jsonable import jsonable
from hfa_model.support.report import Report
from hfa_model.support.text import Table

SUFFIXES = (".json", ".npz", ".mat", ".csv")
_MAT_TEXT = 116  # bytes of free text at the beginning of a .mat file


def check_target(path: str | Path | None, suffixes: tuple[str, ...] = SUFFIXES) -> Path | None:
    """The output file of a command, refused before anything is computed when it cannot be written."""
    if path is None:
        return None
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise BadInputError(f"{path or repr(path)}: unknown suffix {target.suffix!r}; use one of {', '.join(suffixes)}")
    if not target.parent.is_dir():
        raise BadInputError(f"{path}: the folder {target.parent} does not exist; create it first")
    if target.is_dir() and target.suffix.lower() != ".zarr":  # a Zarr store is a folder
        raise BadInputError(f"{path}: it is a folder; name a file")
    return target


def check_folder(path: str) -> Path:
    """A folder that exists or can be made; made only when there is something to put in."""
    folder = Path(path)
    if not path or (not folder.is_dir() and (folder.exists() or not folder.parent.is_dir())):
        raise BadInputError(f"{path or repr(path)}: cannot make the folder; choose another, in a folder that exists")
    return folder


def show(report: Report, *, as_json: bool, target: Path | None) -> None:
    """Print the report or, with `as_json`, its data; write the file, if one was asked for, first."""
    deliver(dict(report.data), report.text, lambda: report.records or Table((), []), as_json=as_json, target=target)


def deliver(
    data: dict[str, Any], text: Callable[[], str], table: Callable[[], Table], *, as_json: bool, target: Path | None
) -> None:
    """Print the text or, with `as_json`, the data; write the file, if one was asked for, first."""
    if target is not None:
        write(target, data, table)
    if as_json:
        print(json.dumps(jsonable(data), indent=2, allow_nan=False))
    else:
        print(text())


def write(target: Path, data: dict[str, Any], table: Callable[[], Table]) -> None:
    """One file, whole or not at all; numbers keep 17 significant digits.

    .json: `data` as it is. .npz: one array a leaf, keys joined by dots. .mat: the same tree as structs.
    .csv: a first line with the schema behind a "#", then `table`, one row a value.
    """
    suffix = target.suffix.lower()
    if suffix == ".json":
        write_text(target, json.dumps(jsonable(data), indent=2, allow_nan=False) + "\n")
    elif suffix == ".npz":
        with written_whole(target) as stream:
            np.savez(stream, allow_pickle=False, **_leaves(data))
    elif suffix == ".mat":
        with written_whole(target) as stream:
            stream.write(_mat(data))
    elif suffix == ".csv":
        write_text(target, f"# schema: {data['schema']}\n" + _csv(*table()))
    else:
        raise ValueError(f"no format for {target}: check_target let it through")


def say_notes(warnings: Iterable[str]) -> None:
    """What a user should know before trusting a result, on standard error, a line each."""
    for warning in warnings:
        print(f"hfa: note: {warning}", file=sys.stderr)


class Progress:
    """A counter on standard error, only when it is a terminal; at most one line, gone when done."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._shown = sys.stderr.isatty()
        self._last = -1

    def __call__(self, done: int, total: int) -> None:
        """Show `done` of `total` when the percentage changed."""
        percent = 100 * done // total
        if self._shown and percent != self._last:
            self._last = percent
            end = "\r\033[K" if done == total else ""
            print(f"\r{self._what}: {percent:3d} %", end=end, file=sys.stderr, flush=True)


def _leaves(data: Any, prefix: str = "") -> dict[str, Any]:
    if isinstance(data, dict):
        parts = (_leaves(value, f"{prefix}.{key}" if prefix else key) for key, value in data.items())
        return {name: leaf for part in parts for name, leaf in part.items()}
    if isinstance(data, list) and data and isinstance(data[0], dict):
        return _leaves({str(index): item for index, item in enumerate(data)}, prefix)
    return {prefix: np.asarray(_numbers(data))}


def _mat(data: dict[str, Any]) -> bytes:
    from scipy.io import savemat

    stream = io.BytesIO()
    savemat(stream, _for_matlab(data), long_field_names=True)
    # SciPy puts the time into the free text that begins the file; the same result shall be the same file.
    return b"MATLAB 5.0 MAT-file, written by hfa".ljust(_MAT_TEXT) + stream.getvalue()[_MAT_TEXT:]


def _for_matlab(data: Any) -> Any:
    if isinstance(data, dict):
        return {_field_name(key): _for_matlab(value) for key, value in data.items()}
    if isinstance(data, list):
        if data and isinstance(data[0], (dict, str)):
            cells = np.empty(len(data), dtype=object)
            cells[:] = [_for_matlab(item) for item in data]
            return cells
        return np.asarray(_numbers(data))
    return _numbers(data)


def _numbers(data: Any) -> Any:
    """None, which stands for a number that is not there, becomes nan at any depth of lists."""
    if isinstance(data, list):
        return [_numbers(item) for item in data]
    return np.nan if data is None else data


def _field_name(key: str) -> str:
    """A name that MATLAB accepts: "15.0" becomes "x15_0", as by its own `makeValidName`."""
    name = re.sub(r"\W", "_", key)
    return name if name[:1].isalpha() else f"x{name}"


def _csv(header: tuple[str, ...], rows: Sequence[tuple[Any, ...]]) -> str:
    import csv

    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(
        [[repr(float(cell)) if isinstance(cell, (float, np.floating)) else cell for cell in row] for row in rows]
    )
    return stream.getvalue()
