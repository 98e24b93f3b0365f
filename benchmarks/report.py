"""The table of figures: printed, stored and drawn."""

from __future__ import annotations

import json
import platform
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from benchmarks.timing import Comparison
from hfa_model.files import write_text
from trim.text import columns

FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Row:
    """One figure: the job, what it is compared with, times, the ratio to reach, and a remark."""

    job: str
    peer: str
    timing: Comparison
    target: float
    remark: str = ""

    @property
    def reached(self) -> bool:
        """Whether ours is at least `target` times as fast as the peer."""
        return self.timing.ratio >= self.target


def machine() -> dict[str, str]:
    """What the figures depend on."""
    packages = {name: version(name) for name in ("casadi", "numpy", "scipy", "control")}
    processor = next(
        (line.split(":")[1].strip() for line in _cpu_lines() if line.startswith("model name")), platform.processor()
    )
    return {"processor": processor, "cores": str(_cores()), "python": platform.python_version(), **packages}


def text(rows: list[Row]) -> str:
    """One line a figure."""
    table = [
        (
            row.job,
            row.peer,
            _time(row.timing.ours),
            _time(row.timing.peer),
            f"{row.timing.ratio:.3g}",
            f"{row.target:.3g}",
            "yes" if row.reached else "NO",
        )
        for row in rows
    ]
    header = ("job", "peer", "ours", "peer's", "times faster", "to reach", "reached")
    remarks = [f"{row.job}: {row.remark}" for row in rows if row.remark]
    return "\n".join([columns(header, table), "", *remarks])


def store(rows: list[Row]) -> Path:
    """Write results.json beside this file."""
    data = {
        "machine": machine(),
        "figures": [
            {
                "job": row.job,
                "peer": row.peer,
                "ours_s": row.timing.ours,
                "peer_s": row.timing.peer,
                "times_faster": row.timing.ratio,
                "to_reach": row.target,
                "reached": row.reached,
                "remark": row.remark,
            }
            for row in rows
        ],
    }
    path = FOLDER / "results.json"
    write_text(path, json.dumps(data, indent=2) + "\n")
    return path


def _time(seconds: float) -> str:
    for factor, unit in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if seconds >= factor:
            return f"{seconds / factor:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def _cpu_lines() -> list[str]:
    try:
        return Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _cores() -> int:
    import os

    return os.cpu_count() or 1
