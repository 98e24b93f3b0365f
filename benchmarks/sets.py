"""The sets of jobs, each run in a process of its own, so that the threads and memory of one do not slow the next."""

from __future__ import annotations

import importlib
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks.report import Row

SETS = ("startup", "trim", "gare", "flight", "no_compiler", "monte_carlo", "dask", "size")


def rows_of(name: str, quick: bool) -> list[Row]:
    """The figures of one set, measured in a new process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
        return apart.submit(_rows, name, quick).result()


def _rows(name: str, quick: bool) -> list[Row]:
    rows: list[Row] = importlib.import_module(f"benchmarks.jobs_{name}").rows(quick=quick)
    return rows
