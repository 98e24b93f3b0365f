"""What the documents say of the stored figures, to be pasted: `python -m benchmarks.documents`."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.report import ratio_text, stored, value_text
from hfa_model.parameters import default_parameters
from trim.sweeps.stored_sweep import SweepJob
from trim.sweeps.sweep_plan import Steps, SweepPlan

_POINTS, _MEMBERS, _CORES = 1_000_000_000, 1_000_000, 1000
#: What the file system or the network of a cluster takes as a whole, bytes a second.
_STREAM = 1e9
#: The jobs in README.md: start-up, a sweep, the certified game.
HEADLINES = (
    "`hfa trim --dihedral 15`, new process",
    "10000 dihedral angles, generated C",
    "1000 game Riccati equations, certified",
)


def documented(results: dict[str, Any]) -> dict[str, tuple[str, ...]]:
    """Document -> the tables and lists that it shows."""
    figures = results["figures"]
    headlines = [figure for figure in figures if figure["job"] in HEADLINES]
    targeted = [figure for figure in figures if figure["to_reach"] is not None]
    others = [figure for figure in figures if figure["to_reach"] is None]
    scaling = (markdown(targeted), markdown(others), growth_table(results), arithmetic(results))
    return {"README.md": (markdown(headlines),), "docs/scaling.md": scaling}


def markdown(figures: Iterable[dict[str, Any]]) -> str:
    """The figures as a table, one row each."""
    lines = ["| job | compared with | ours | peer's | ratio | target | met |", "|---|---|---|---|---|---|---|"]
    for figure in figures:
        ours, peers = (value_text(figure[name], figure["unit"]) for name in ("ours", "peers"))
        ratio, target = ratio_text(figure["ratio"]), ratio_text(figure["to_reach"])
        cells = (figure["job"], figure["peer"], ours, peers, ratio, target, figure["reached"])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def growth_table(results: dict[str, Any]) -> str:
    """Cost of a row, memory and disk against the number of rows, as a table for a document."""
    lines = ["| rows | job | time a row | largest memory | disk a row |", "|---|---|---|---|---|"]
    for figure in results["figures"]:
        name = figure["job"].split(" ", 1)[1].partition(",")[0] if figure["sizes"] else ""
        for size in figure["sizes"]:
            time, memory = value_text(size["seconds"], "s"), f"{size['memory']:.0f} MB"
            lines.append(f"| {size['rows']:,} | {name} | {time} | {memory} | {size['disk']:.0f} B |")
    return "\n".join(lines)


def arithmetic(results: dict[str, Any]) -> str:
    """1e9 points and 1e6 flights on 1000 cores, from the largest sizes measured, as a list for a document."""
    point = next(figure["sizes"][-1] for figure in results["figures"] if "points of a sweep into" in figure["job"])
    flight = next(figure for figure in results["figures"] if figure["set"] == "monte_carlo")
    processes = int(results["machine"]["cores"])
    points = SweepPlan({"dihedral": Steps(0.0, 1e-9, _POINTS)}, default_parameters().values, "published")
    layout = SweepJob(points).layout
    row = sum(math.prod(array.shape) * np.dtype(array.kind).itemsize for array in layout.arrays.values())
    chunks, chunk_time = _POINTS // layout.chunk, layout.chunk * point["seconds"]
    work, disk, raw = (_POINTS * cost for cost in (point["seconds"], point["disk"], row))
    flown = _MEMBERS * processes * flight["ours"]
    return f"""\
- Work: 1e9 points x {value_text(point["seconds"], "s")} = {work:,.0f} core seconds = {work / 3600:.1f} core hours; on
  {_CORES} cores {work / _CORES:.1f} s, if nothing else took time.
- Chunks: 1e9 / {layout.chunk:,} = {chunks:,}, {chunks // _CORES} a core; each is {chunk_time:.2f} s of work and
  {layout.chunk * point["disk"] / 1e6:.0f} MB on disk.
- Memory: {point["memory"]:.0f} MB a process, whatever the number of points.
- Disk: 1e9 x {point["disk"]:.0f} B = {disk / 1e9:.0f} GB. Workers that see the store write their chunks themselves; at
  1 GB/s for the whole file system that is {disk / _STREAM:.0f} s = {disk / _STREAM / 60:.1f} minutes.
- Without a shared disk all rows pass through one process, uncompressed: 1e9 x {row} B = {raw / 1e9:.0f} GB,
  {raw / _STREAM / 60:.0f} minutes at 1 GB/s.
- 1e6 flights of 20 s with the learning critic: 1e6 x {flight["ours"]:.3g} s x {processes} processes =
  {flown / 3600:.0f} core hours, {flown / _CORES / 60:.0f} minutes on {_CORES} cores."""


if __name__ == "__main__":
    for document, parts in documented(stored()).items():
        print(f"{document}\n", *parts, sep="\n", end="\n\n")
