"""The table of figures: printed and stored."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.timing import Comparison
from hfa_support.files import write_text
from hfa_support.reporting.text import columns

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results.json"
_PACKAGES = ("casadi", "numpy", "scipy", "control", "zarr", "distributed", "numba", "jax")


class Size(NamedTuple):
    """One size of a job that grows: rows of the job, seconds a row, largest memory of its process in MB, and bytes that
    a row takes on disk."""

    rows: int
    seconds: float
    memory: float
    disk: float


@dataclass(frozen=True)
class Row:
    """One figure: the job, what it is compared with, times, the target of the ratio, and a remark.

    target: None where the peer is there for orientation. unit: of the two values, "s" or "MB". sizes: how the job
    grows, where that is the question.
    """

    job: str
    peer: str
    timing: Comparison
    target: float | None
    remark: str = ""
    unit: str = "s"
    sizes: tuple[Size, ...] = ()

    @property
    def verdict(self) -> str:
        """Whether ours is at least `target` times as fast (or small) as the peer; "-" without a target."""
        if self.target is None:
            return "-"
        return "yes" if self.timing.ratio >= self.target else "NO"


def machine() -> dict[str, str]:
    """What the figures depend on."""
    processor = next(
        (line.split(":")[1].strip() for line in _cpu_lines() if line.startswith("model name")), platform.processor()
    )
    own = {"processor": processor, "cores": str(os.cpu_count() or 1), "python": platform.python_version()}
    return own | {name: found for name in _PACKAGES if (found := _version(name))}


def text(rows: list[Row]) -> str:
    """One line a figure, then the remarks."""
    table = [
        (
            row.job,
            row.peer,
            value_text(row.timing.ours, row.unit),
            value_text(row.timing.peer, row.unit),
            ratio_text(row.timing.ratio),
            ratio_text(row.target),
            row.verdict,
        )
        for row in rows
    ]
    header = ("job", "peer", "ours", "peer's", "ratio", "target", "met")
    remarks = [f"{row.job}, {row.peer}: {row.remark}" for row in rows if row.remark]
    return "\n".join([columns(header, table), "", *remarks])


def data(rows: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Machine and figures, ready for JSON. rows: name of a set of jobs -> its rows."""
    figures = [
        {
            "set": name,
            "job": row.job,
            "peer": row.peer,
            "ours": row.timing.ours,
            "peers": row.timing.peer,
            "unit": row.unit,
            "ratio": row.timing.ratio,
            "to_reach": row.target,
            "reached": row.verdict,
            "remark": row.remark,
            "sizes": [size._asdict() for size in row.sizes],
        }
        for name, some in rows.items()
        for row in some
    ]
    return {"machine": machine(), "figures": figures}


def store(rows: Mapping[str, list[Row]], order: Sequence[str]) -> dict[str, Any]:
    """Write results.json beside this file and return it.

    Sets that were not run keep their figures, if they are of this machine with these versions; order: of the sets.
    """
    new = data(rows)
    if RESULTS.exists() and (old := stored())["machine"] == new["machine"]:
        new["figures"] += [figure for figure in old["figures"] if figure["set"] not in rows]
    new["figures"].sort(key=lambda figure: order.index(figure["set"]))
    write_text(RESULTS, json.dumps(new, indent=2, ensure_ascii=False) + "\n")
    return new


def stored() -> dict[str, Any]:
    """What was stored last."""
    result: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return result


def value_text(value: float, unit: str) -> str:
    """A time with a prefix that suits it, or megabytes."""
    if unit != "s":
        return f"{value:.3g} {unit}"
    for factor, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= factor:
            return f"{value / factor:.3g} {name}"
    return f"{value / 1e-9:.3g} ns"


def ratio_text(ratio: float | None) -> str:
    """Three digits, without a power of ten."""
    return "-" if ratio is None else f"{float(f'{ratio:.3g}'):.12g}"


def _cpu_lines() -> list[str]:
    try:
        return Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
