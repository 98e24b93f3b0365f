"""Options for computing many points in parallel processes."""

from __future__ import annotations

from dataclasses import dataclass

from hfa.options.argument_types import whole
from hfa.options.option import option

MOST_WORKERS = 1000


def _workers(text: str) -> int | str:
    """Return the number of worker processes, or the address of a Dask scheduler."""
    return text if "://" in text else whole(1, MOST_WORKERS)(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class WorkerOptions:
    """The worker processes of a run into a store."""

    workers: int | str = option(
        "number of processes, or address of a Dask scheduler (tcp://host:port); default 1",
        "N|URL",
        _workers,
        default=1,
        rare=True,
    )
    resume: bool = option("continue an interrupted run with the same options", rare=True)
