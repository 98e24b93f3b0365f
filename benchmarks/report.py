"""Two jobs timed in turn, and the figures of all comparisons: as a table, as a file, as a
picture."""

from __future__ import annotations

import importlib
import json
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from hfa_support.files import write_text
from hfa_support.reporting.figure import new_figure, save
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results.json"
PICTURE = FOLDER.parent / "docs" / "pictures" / "benchmarks.png"
#: Module of jobs -> the names of its jobs.
SUBJECTS = {
    "models": ("start", "trim", "angles", "f16", "games"),
    "flight": ("loop",),
    "scale": ("members", "sweep_store", "member_store"),
    "jsbsim": ("737", "environments"),
    "optimal": ("best_flight",),
    "identify": ("record",),
}
_PACKAGES = ("casadi", "numpy", "scipy", "control", "zarr")


class Comparison(NamedTuple):
    """Medians over the repeats, seconds for one unit of work, and the median of the ratios pair by
    pair."""

    ours: float
    peer: float
    ratio: float

    @classmethod
    def of(cls, ours: list[float], peer: list[float]) -> Comparison:
        """From times measured in turn. ratio: peer / ours, how many times faster ours is."""
        ratios = [b / a for a, b in zip(ours, peer, strict=True)]
        return cls(statistics.median(ours), statistics.median(peer), statistics.median(ratios))


def in_turn(
    ours: Callable[[], Any],
    peer: Callable[[], Any],
    units: float = 1.0,
    peer_units: float = 1.0,
    *,
    repeats: int = 7,
) -> Comparison:
    """Ours, peer, ours, peer, ... after one uncounted round: a drift of the machine's speed is fair
    to both.

    units: pieces of work in one call of each.
    """
    ours()
    peer()
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeats):
        for function, size, row in ((ours, units, times[0]), (peer, peer_units, times[1])):
            start = time.perf_counter()
            function()
            row.append((time.perf_counter() - start) / size)
    return Comparison.of(*times)


class Size(NamedTuple):
    """One size of a job that grows: rows of the job, seconds a row, largest memory of its process
    in MB, and bytes that a row takes on disk."""

    rows: int
    seconds: float
    memory: float
    disk: float


class Limit(NamedTuple):
    """The least time that one unit of a job can take on this machine.

    seconds: measured here and now
    what: the work that no program can leave out
    """

    seconds: float
    what: str


class Row(NamedTuple):
    """One comparison.

    target: of the ratio
    unit: "s" or "MB"
    limit: None where nothing shorter than the job is known to be needed
    """

    job: str
    peer: str
    timing: Comparison
    target: float
    remark: str = ""
    unit: str = "s"
    sizes: tuple[Size, ...] = ()
    limit: Limit | None = None

    @property
    def verdict(self) -> str:
        """Return "yes" if ours is at least `target` times as fast (or small) as the peer."""
        return "yes" if self.timing.ratio >= self.target else "NO"


def jobs() -> dict[str, str]:
    """The name of each job and the module that has it, in the order of the table."""
    return {name: module for module, names in SUBJECTS.items() for name in names}


def rows_of(job: str, quick: bool) -> list[Row]:
    """The figures of one job, measured here and now."""
    module = importlib.import_module(f"benchmarks.jobs_{jobs()[job]}")
    found: list[Row] = module.JOBS[job](quick)
    return found


def shortest(function: Callable[[], Any], units: float = 1.0, repeats: int = 7) -> float:
    """The shortest time of a function, after one uncounted call: seconds a unit of work."""
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times) / units


def figure(row: Row, name: str = "") -> dict[str, Any]:
    """A comparison, ready for JSON, of the job of this name."""
    ours, peers, ratio = row.timing
    found = {
        "set": name,
        "job": row.job,
        "peer": row.peer,
        "ours": ours,
        "peers": peers,
        "unit": row.unit,
    }
    found |= {"ratio": ratio, "to_reach": row.target, "reached": row.verdict, "remark": row.remark}
    found["limit"] = None if row.limit is None else row.limit._asdict()
    return found | {"sizes": [size._asdict() for size in row.sizes]}


def markdown(figures: Iterable[dict[str, Any]]) -> str:
    """The figures as a table, one row each."""
    rows = []
    for each in figures:
        times = (value_text(each[name], each["unit"]) for name in ("ours", "peers"))
        ratios = (ratio_text(each[name]) for name in ("ratio", "to_reach"))
        limit = limit_text(each)
        rows.append((each["job"], each["peer"], *times, *ratios, each["reached"], limit))
    names = ("job", "compared with", "ours", "peer's", "ratio", "target", "met", "over the limit")
    return markdown_table(Table(names, rows))


def limit_text(figure: Mapping[str, Any]) -> str:
    """Our time over the limit, and of what work that is; a dash where none is known."""
    limit = figure["limit"]
    if limit is None:
        return "–"
    return f"{figure['ours'] / limit['seconds']:.2g} x {limit['what']}"


def value_text(value: float, unit: str) -> str:
    """A time with a prefix that suits it, or megabytes."""
    if unit != "s":
        return f"{value:.3g} {unit}"
    for factor, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= factor:
            return f"{value / factor:.3g} {name}"
    return f"{value / 1e-9:.3g} ns"


def ratio_text(ratio: float) -> str:
    """Three digits, without a power of ten."""
    return f"{float(f'{ratio:.3g}'):.12g}"


def machine() -> dict[str, str]:
    """Return the data of the machine on which the figures depend."""
    lines = (
        Path("/proc/cpuinfo").read_text("utf-8").splitlines()
        if Path("/proc/cpuinfo").exists()
        else []
    )
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    found = {"processor": (names or [platform.processor()])[0], "cores": str(os.cpu_count() or 1)}
    return (
        found | {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES}
    )


def store(rows: Mapping[str, list[Row]]) -> dict[str, Any]:
    """Write results.json and return it. Jobs that were not run keep their figures if the machine is
    the same."""
    new = {
        "machine": machine(),
        "figures": [figure(row, name) for name, some in rows.items() for row in some],
    }
    if RESULTS.exists() and (old := stored())["machine"] == new["machine"]:
        new["figures"] += [each for each in old["figures"] if each["set"] not in rows]
    order = list(jobs())
    new["figures"].sort(key=lambda each: order.index(each["set"]))
    write_text(RESULTS, json.dumps(new, indent=2, ensure_ascii=False) + "\n")
    return new


def stored() -> dict[str, Any]:
    """Return the figures stored last."""
    result: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return result


def draw(data: dict[str, Any], path: Path = PICTURE) -> Path:
    """Draw bars of the ratios, those below 1 in orange, with targets and limits; curves of time and
    memory against size."""
    bars = [each for each in data["figures"] if not each["sizes"] and each["unit"] == "s"]
    picture = new_figure(11.0, 0.42 * len(bars) + 4.4)
    above, below = picture.subfigures(2, 1, height_ratios=[0.42 * len(bars) + 0.6, 3.2])
    axes = above.subplots()
    for place, each in enumerate(reversed(bars)):
        axes.barh(
            place,
            each["ratio"],
            height=0.6,
            color="#2a6f97" if each["ratio"] >= 1.0 else "#c1440e",
        )
        end = each["ratio"]
        if each["limit"] is not None:
            limit = each["peers"] / each["limit"]["seconds"]
            axes.plot([limit, limit], [place - 0.4, place + 0.4], color="black", linewidth=1.5)
            end = max(end, limit)
        axes.plot(
            each["to_reach"], place, "D", color="white", markeredgecolor="black", markersize=5
        )
        end = max(end, each["to_reach"])
        axes.text(1.08 * end, place, ratio_text(each["ratio"]), va="center", fontsize=8)
    axes.set_yticks(
        range(len(bars)), [f"{each['job']}\nagainst {each['peer']}" for each in reversed(bars)]
    )
    axes.tick_params(axis="y", labelsize=7)
    axes.set(
        xscale="log",
        xlim=(0.3, 5000),
        xlabel="time of the peer divided by ours (orange: slower than the peer)",
    )
    axes.plot([], [], color="black", linewidth=1.5, label="limit of this machine")
    axes.plot([], [], "D", color="white", markeredgecolor="black", markersize=5, label="target")
    axes.legend(loc="lower right", fontsize=8)
    axes.axvline(1.0, color="black", linewidth=0.5)
    time_axes, memory = below.subplots(1, 2)
    for each in data["figures"]:
        rows = [size["rows"] for size in each["sizes"]]
        label = each["job"].split(" ", 1)[1].partition(",")[0]
        if rows:
            time_axes.loglog(
                rows, [1e6 * size["seconds"] for size in each["sizes"]], "o-", label=label
            )
            memory.semilogx(rows, [size["memory"] for size in each["sizes"]], "o-", label=label)
            memory.legend(fontsize=8, loc="lower right")
    for lower, name in ((time_axes, "time a row, µs"), (memory, "largest memory, MB")):
        lower.set(xlabel="rows", ylabel=name)
        lower.grid(alpha=0.3)
    memory.set_ylim(bottom=0)
    save(
        picture,
        path,
        "measured with "
        + ", ".join(f"{name} {version}" for name, version in data["machine"].items()),
    )
    return path
