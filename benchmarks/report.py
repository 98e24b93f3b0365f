"""Timing of two functions in turn, and report of the comparisons as tables, file and picture."""

from __future__ import annotations

import importlib
import json
import math
import os
import platform
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from hfa_support.errors import BadInputError
from hfa_support.files import write_text
from hfa_support.reporting.figure import new_figure, save
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results.json"
#: Document of rows that miss their target or were listed before, and document of all other rows.
PAGES = (FOLDER.parent / "docs" / "scaling.md", FOLDER / "README.md")
PICTURE = FOLDER.parent / "docs" / "pictures" / "benchmarks.png"
#: Module -> names of its jobs.
SUBJECTS = {
    "models": ("start", "trim", "angles", "f16", "one_game"),
    "flight": ("loop", "members"),
    "jsbsim": ("737", "environments"),
    "optimal": ("best_flight",),
    "identify": ("record", "records"),
    "region": ("gtm_region",),
    "scale": ("points", "flights", "states", "solve", "solve_command", "networks"),
}
#: A job is at its limit if its time is within this factor of the least time on this machine.
AT_LIMIT = 1.3
_PACKAGES = ("casadi", "numpy", "scipy", "control", "zarr")


class Comparison(NamedTuple):
    """Times of the project and its peer for the same work.

    ours: median time of the project for one unit of work, s
    peer: median time of the peer for one unit of work, s
    ratio: median ratio peer / ours
    """

    ours: float
    peer: float
    ratio: float

    @classmethod
    def of(cls, ours: list[float], peer: list[float]) -> Comparison:
        """Return the medians of times measured in turn, and of their ratios peer / ours.

        ours: times of the project, s
        peer: times of the peer, s
        """
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
    """Return the times of two functions, called alternately after one uncounted call of each.

    A drift of the machine's speed then affects both functions equally.

    ours: function of the project
    peer: function of the peer
    units: units of work in one call of `ours`
    peer_units: units of work in one call of `peer`
    repeats: timed calls of each
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
    """Time and memory of a growing job at one size.

    size: size of the job
    seconds: time, s
    memory: peak memory of the process, MB
    """

    size: int
    seconds: float
    memory: float


class Growth(NamedTuple):
    """Measured times and memories of a job at increasing sizes.

    job: description of the job
    unit: unit of the sizes
    sizes: measurements, the smallest size first
    """

    job: str
    unit: str
    sizes: tuple[Size, ...]

    @property
    def slope(self) -> float:
        """Exponent p of time ~ size^p, fitted to the larger half of the sizes."""
        upper = self.sizes[-(len(self.sizes) // 2 + 1) :]
        logarithms = [(math.log(each.size), math.log(each.seconds)) for each in upper]
        return statistics.linear_regression(*zip(*logarithms, strict=True)).slope


class Limit(NamedTuple):
    """Least time of one unit of a job on this machine.

    seconds: measured time of the unavoidable work
    what: description of the unavoidable work
    """

    seconds: float
    what: str


class Row(NamedTuple):
    """Result of one comparison of the project with a peer.

    job: description of the job
    peer: description of the peer
    timing: times of the project and the peer
    target: required ratio of the times, peer / ours
    remark: additional text, for the file of results
    limit: least time of the job, or None if unknown
    """

    job: str
    peer: str
    timing: Comparison
    target: float
    remark: str = ""
    limit: Limit | None = None

    @property
    def verdict(self) -> str:
        """Verdict on the ratio of the times, peer / ours.

        - "yes": the ratio reaches the target.
        - "limit": the project's time is at most `AT_LIMIT` times the least possible time.
        - "NO": neither.
        """
        if self.timing.ratio >= self.target:
            return "yes"
        if self.limit is not None and self.timing.ours <= AT_LIMIT * self.limit.seconds:
            return "limit"
        return "NO"


#: Name of a job -> its results.
Results = Mapping[str, Sequence[Row | Growth]]


def jobs() -> dict[str, str]:
    """Return the jobs in the order of the table, name of a job -> its subject."""
    return {name: module for module, names in SUBJECTS.items() for name in names}


def rows_of(job: str, quick: bool) -> list[Row | Growth]:
    """Return the results of one job: its comparisons or its measurements.

    job: name of the job
    quick: whether the job has a toy size
    """
    module = importlib.import_module(f"benchmarks.jobs_{jobs()[job]}")
    found: list[Row | Growth] = module.JOBS[job](quick)
    return found


def shortest(function: Callable[[], Any], units: float = 1.0, repeats: int = 7) -> float:
    """Return the shortest time of `repeats` calls per unit of work, s, after one uncounted call.

    units: units of work in one call
    """
    function()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times) / units


def figure(runs: Sequence[Row], name: str = "") -> dict[str, Any]:
    """Return the results of one comparison in several runs, for JSON.

    The results are those of the run with the median ratio, and the smallest and largest ratio of
    all runs.

    runs: the same comparison in each run
    name: name of the job
    """
    by_ratio = sorted(runs, key=lambda run: run.timing.ratio)
    row = by_ratio[len(by_ratio) // 2]
    ours, peers, ratio = row.timing
    return {
        "set": name,
        "job": row.job,
        "peer": row.peer,
        "ours": ours,
        "peers": peers,
        "ratio": ratio,
        "ratios": [by_ratio[0].timing.ratio, by_ratio[-1].timing.ratio],
        "runs": len(runs),
        "to_reach": row.target,
        "reached": row.verdict,
        "remark": row.remark,
        "limit": None if row.limit is None else row.limit._asdict(),
    }


def figures(runs: Sequence[Results]) -> list[dict[str, Any]]:
    """Return the results of all comparisons in several runs, for JSON.

    runs: results of the same jobs in each run
    """
    found = []
    for name in runs[0]:
        rows = [[each for each in run[name] if isinstance(each, Row)] for run in runs]
        found += [figure(same, name) for same in zip(*rows, strict=True)]
    return found


def growths(runs: Sequence[Results]) -> list[dict[str, Any]]:
    """Return the measurements of the growing jobs in the first run, for JSON.

    runs: results of the same jobs in each run
    """
    return [
        {
            "set": name,
            "job": each.job,
            "unit": each.unit,
            "slope": each.slope,
            "sizes": [size._asdict() for size in each.sizes],
        }
        for name, some in runs[0].items()
        for each in some
        if isinstance(each, Growth)
    ]


def markdown(figures: Iterable[dict[str, Any]]) -> str:
    """Return the results of comparisons as a Markdown table.

    figures: results from `figure`
    """
    rows = []
    for each in figures:
        times = (value_text(each[name]) for name in ("ours", "peers"))
        ratio = f"{ratio_text(each['ratio'])} ({'..'.join(map(ratio_text, each['ratios']))})"
        target = ratio_text(each["to_reach"])
        ends = (each["reached"], limit_text(each))
        rows.append((each["job"], each["peer"], *times, ratio, target, *ends))
    names = ("job", "compared with", "ours", "peer's", "ratio", "target", "met", "over the limit")
    return markdown_table(Table(names, rows))


def growth_markdown(grown: Iterable[dict[str, Any]]) -> str:
    """Return the measurements of growing jobs as a Markdown table.

    grown: measurements from `growths`
    """
    rows = []
    for each in grown:
        first, last = each["sizes"][0], each["sizes"][-1]
        sizes = f"{first['size']:,} to {last['size']:,} {each['unit']}"
        times = (value_text(last["seconds"]), f"{last['memory']:.0f} MB")
        rows.append((each["job"], sizes, f"{each['slope']:.2f}", *times))
    names = ("job", "sizes", "slope of time", "largest: time", "memory")
    return markdown_table(Table(names, rows))


def limit_text(figure: Mapping[str, Any]) -> str:
    """Return the project's time relative to the least possible time as text.

    The text also describes the work of the least time. It is "–" if the least time is unknown.

    figure: result from `figure`
    """
    limit = figure["limit"]
    if limit is None:
        return "–"
    return f"{figure['ours'] / limit['seconds']:.2g} x {limit['what']}"


def value_text(value: float) -> str:
    """Return a time as text in s, ms, µs or ns.

    value: s
    """
    for factor, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs")):
        if value >= factor:
            return f"{value / factor:.3g} {name}"
    return f"{value / 1e-9:.3g} ns"


def ratio_text(ratio: float) -> str:
    """Return a ratio as text with three significant digits, not in scientific notation."""
    return f"{float(f'{ratio:.3g}'):.12g}"


def machine() -> dict[str, str]:
    """Return the processor, the number of cores, and the versions of Python and some packages, by
    name.
    """
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


def store(runs: Sequence[Results]) -> dict[str, Any]:
    """Write the results of the jobs to results.json, and return the content of the file.

    Stored results of other jobs are kept. They share one machine and one set of versions.

    runs: results of the same jobs in each run; growing jobs have results in the first run only

    Raises BadInputError if results of other jobs were stored by another machine or other versions.
    """
    new: dict[str, Any] = {"machine": machine(), "figures": figures(runs), "growth": growths(runs)}
    if RESULTS.exists():
        old = stored()
        fresh = {each["set"] for kind in ("figures", "growth") for each in new[kind]}
        for kind in ("figures", "growth"):
            kept = [each for each in old[kind] if each["set"] not in fresh]
            if kept and old["machine"] != new["machine"]:
                raise BadInputError(
                    "nothing is stored: the other jobs were measured with another machine or other "
                    "versions; run all jobs"
                )
            new[kind] += kept
    order = list(jobs())
    for kind in ("figures", "growth"):
        new[kind].sort(key=lambda each: order.index(each["set"]))
    write_text(RESULTS, json.dumps(new, indent=2, ensure_ascii=False) + "\n")
    return new


def show(data: Mapping[str, Any]) -> None:
    """Write the tables of results into the two documents `PAGES`.

    The first document receives the comparisons that it already contains and those with a missed
    target. The second document receives the other comparisons and the growing jobs.

    data: content of results.json
    """
    first, second = (page.read_text("utf-8") for page in PAGES)
    on_first = [
        each
        for each in data["figures"]
        if each["reached"] == "NO" or f"\n| {each['job']} |" in first
    ]
    others = [each for each in data["figures"] if each not in on_first]
    write_text(PAGES[0], with_table(first, markdown(on_first)))
    second = with_table(second, markdown(others))
    write_text(PAGES[1], with_table(second, growth_markdown(data["growth"])))


def with_table(page: str, table: str) -> str:
    """Return a Markdown page with one table replaced.

    page: text of the page
    table: new table; it replaces the table of the page with the same header
    """
    heads = table.splitlines()[0]
    before, found, after = page.partition(heads)
    assert found, f"the page has no table {heads}"
    rest = after.lstrip("\n").splitlines(keepends=True)
    end = next((number for number, line in enumerate(rest) if line[0] != "|"), len(rest))
    return f"{before}{table.rstrip()}\n{''.join(rest[end:])}"


def stored() -> dict[str, Any]:
    """Return the results of the benchmarks, the content of results.json."""
    result: dict[str, Any] = json.loads(RESULTS.read_text(encoding="utf-8"))
    return result


def draw(data: dict[str, Any], path: Path = PICTURE) -> Path:
    """Draw the results of the benchmarks, and return the path of the picture.

    The picture shows bars of the ratios, and curves of time and memory versus size.

    data: content of results.json
    path: path of the picture
    """
    bars = data["figures"]
    picture = new_figure(11.0, 0.42 * len(bars) + 4.4)
    parts = picture.subfigures(2, 1, squeeze=False, height_ratios=[0.42 * len(bars) + 0.6, 3.2])
    above, below = parts[:, 0]
    _draw_bars(above.subplots(), bars)
    time_axes, memory_axes = below.subplots(1, 2)
    for each in data["growth"]:
        sizes = [size["size"] for size in each["sizes"]]
        label = f"{each['job']}: size^{each['slope']:.2f}"
        seconds = [size["seconds"] for size in each["sizes"]]
        time_axes.loglog(sizes, seconds, "o-", markersize=4, label=label)
        memory = [size["memory"] for size in each["sizes"]]
        memory_axes.loglog(sizes, memory, "o-", markersize=4, label=each["unit"])
    for axes, name in ((time_axes, "time, s"), (memory_axes, "largest memory, MB")):
        axes.set(xlabel="points, flights, states, or units a layer", ylabel=name)
        axes.grid(alpha=0.3)
        if data["growth"]:
            axes.legend(fontsize=7, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    save(
        picture,
        path,
        "measured with "
        + ", ".join(f"{name} {version}" for name, version in data["machine"].items()),
    )
    return path


def _draw_bars(axes: Any, bars: Sequence[dict[str, Any]]) -> None:
    for place, each in enumerate(reversed(bars)):
        color = "#2a6f97" if each["ratio"] >= 1.0 else "#c1440e"
        axes.barh(place, each["ratio"], height=0.6, color=color)
        low, high = each["ratios"]
        axes.plot([low, high], [place, place], color="black", linewidth=0.8)
        end = high
        if each["limit"] is not None:
            limit = each["peers"] / each["limit"]["seconds"]
            axes.plot([limit, limit], [place - 0.4, place + 0.4], color="black", linewidth=1.5)
            end = max(end, limit)
        axes.plot(
            each["to_reach"], place, "D", color="white", markeredgecolor="black", markersize=5
        )
        end = max(end, each["to_reach"])
        axes.text(1.25 * end, place, ratio_text(each["ratio"]), va="center", fontsize=8)
    axes.set_yticks(
        range(len(bars)), [f"{each['job']}\nagainst {each['peer']}" for each in reversed(bars)]
    )
    axes.tick_params(axis="y", labelsize=7)
    axes.set(
        xscale="log",
        xlim=(0.2, 5000),
        ylim=(-0.6, len(bars) - 0.4),
        xlabel="time of the peer divided by ours (orange: slower than the peer)",
    )
    axes.plot([], [], color="black", linewidth=1.5, label="limit of this machine")
    axes.plot([], [], color="black", linewidth=0.8, label="smallest and largest of the runs")
    axes.plot([], [], "D", color="white", markeredgecolor="black", markersize=5, label="target")
    axes.legend(loc="lower right", fontsize=8)
    axes.axvline(1.0, color="black", linewidth=0.5)
