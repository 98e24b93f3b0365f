"""Timing of two functions in turn, and the table of the comparisons in benchmarks/README.md."""

from __future__ import annotations

import os
import platform
import statistics
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.ticker import EngFormatter

from hfa_support.files import write_text
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table

PAGE = Path(__file__).with_name("README.md")
#: Lines of the page between which the figures are written.
BEGIN, END = "<!-- figures of make bench -->", "<!-- end of the figures -->"
_PACKAGES = ("casadi", "numpy", "scipy", "control")


class Comparison(NamedTuple):
    """Times of the project and of its peer for the same work, in several rounds.

    job: description of the work
    peer: description of the peer, or of a goal
    ours: median time of the project for one unit of work, s
    theirs: median time of the peer, s
    ratios: smallest, median and largest ratio theirs / ours of the rounds
    goal: required median ratio
    """

    job: str
    peer: str
    ours: float
    theirs: float
    ratios: tuple[float, float, float]
    goal: float


def in_turn(
    job: str,
    peer: str,
    goal: float,
    ours: Callable[[], Any],
    theirs: Callable[[], Any] | float,
    units: tuple[float, float] = (1.0, 1.0),
    rounds: int = 5,
    agree: Callable[[Any, Any], None] | None = None,
) -> Comparison:
    """Return the times of two functions, called alternately after one uncounted call of each.

    A drift of the machine's speed then affects both functions equally.

    theirs: function of the peer, or a fixed time, s
    units: units of work in one call of each
    rounds: number of timed calls of each
    agree: function of both results that asserts their equality; None for a goal, not a peer
    """
    functions = [function for function in (ours, theirs) if callable(function)]
    results = [function() for function in functions]
    if agree is not None:
        agree(*results)
    times: list[list[float]] = [[], []]
    for _ in range(rounds):
        for place, function in enumerate(functions):
            start = time.perf_counter()
            function()
            times[place].append((time.perf_counter() - start) / units[place])
    if not callable(theirs):
        times[1] = [theirs] * rounds
    ratios = [their_time / our_time for our_time, their_time in zip(*times, strict=True)]
    our_median, their_median = map(statistics.median, times)
    least_to_most = (min(ratios), statistics.median(ratios), max(ratios))
    return Comparison(job, peer, our_median, their_median, least_to_most, goal)


def markdown(rows: Sequence[Comparison]) -> str:
    """Return the comparisons as a Markdown table."""
    head = ("job", "compared with", "ours", "peer's", "ratio", "goal", "met")
    cells = []
    for row in rows:
        low, middle, high = map(ratio_text, row.ratios)
        met = "yes" if row.ratios[1] >= row.goal else "NO"
        times = time_text(row.ours), time_text(row.theirs)
        ratio = f"{middle} ({low}..{high})"
        cells.append((row.job, row.peer, *times, ratio, ratio_text(row.goal), met))
    return markdown_table(Table(head, cells))


def time_text(seconds: float) -> str:
    """Return a time as text with three significant digits, in s, ms, µs or ns."""
    return str(EngFormatter("s")(float(f"{seconds:.3g}")))


def ratio_text(ratio: float) -> str:
    """Return a ratio as text with three significant digits, not in scientific notation."""
    return f"{float(f'{ratio:.3g}'):.12g}"


def machine() -> dict[str, str]:
    """Return processor, number of cores, commit, and versions of Python and some packages."""
    lines = []
    if (processors := Path("/proc/cpuinfo")).exists():
        lines = processors.read_text("utf-8").splitlines()
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    found = {"processor": (names or [platform.processor()])[0], "cores": str(os.cpu_count() or 1)}
    versions = {name: version(name) for name in _PACKAGES}
    return found | {"python": platform.python_version(), "commit": commit()} | versions


def commit() -> str:
    """Return the commit of the measured code, "+" after it if files other than the figures are
    changed, or "unknown".
    """
    try:
        head = _git("rev-parse", "--short=9", "HEAD")
        changed = _git("status", "--porcelain", "--untracked-files=no", "--", ":/", ":!benchmarks")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{head}+" if changed else head


def _git(*words: str) -> str:
    """Return what a command of Git prints."""
    command = ["git", "-C", str(PAGE.parent.parent), *words]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def store(measured: Mapping[str, Sequence[Comparison]], loads: Sequence[float]) -> None:
    """Write the comparisons of all jobs and where they were measured into the page.

    measured: comparisons by name of the job
    loads: load average of the machine before each job
    """
    on = machine()
    versions = ", ".join(f"{name} {on[name]}" for name in ("python", *_PACKAGES))
    table = markdown([row for rows in measured.values() for row in rows]).rstrip()
    before, _, after = PAGE.read_text("utf-8").partition(BEGIN)
    figures = (
        f"{table}\n\nMeasured of commit {on['commit']} on {on['processor']} with "
        f"{on['cores']} cores ({versions}); load average before the jobs {min(loads):.2g} to "
        f"{max(loads):.2g}.\n"
    )
    write_text(PAGE, f"{before}{BEGIN}\n\n{figures}\n{END}{after.partition(END)[2]}")
