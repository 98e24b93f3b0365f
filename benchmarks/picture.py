"""The table as a picture for the README: how many times faster, and what a row costs as jobs grow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks.report import FOLDER, ratio_text
from hfa_support.reporting.figure import new_figure, save

PICTURE = FOLDER.parent / "docs" / "pictures" / "benchmarks.png"
_MET, _MISSED = "#2a6f97", "#c1440e"


def draw(data: dict[str, Any], path: Path = PICTURE) -> Path:
    """Bars of the ratios that have a target, with a mark there; curves of time and memory against size."""
    speeds = [figure for figure in data["figures"] if not figure["sizes"] and figure["unit"] == "s"]
    bars = [figure for figure in speeds if figure["to_reach"] is not None]
    curves = [figure for figure in data["figures"] if figure["sizes"]]
    picture = new_figure(11.0, 0.42 * len(bars) + 4.4)
    above, below = picture.subfigures(2, 1, height_ratios=[0.42 * len(bars) + 0.6, 3.2])
    _ratios(above.subplots(), bars)
    time, memory = below.subplots(1, 2)
    for figure in curves:
        rows = [size["rows"] for size in figure["sizes"]]
        label = figure["job"].split(" ", 1)[1].partition(",")[0]
        time.loglog(rows, [1e6 * size["seconds"] for size in figure["sizes"]], "o-", label=label)
        memory.semilogx(rows, [size["memory"] for size in figure["sizes"]], "o-", label=label)
    for axes, name in ((time, "time a row, µs"), (memory, "largest memory, MB")):
        axes.set(xlabel="rows", ylabel=name)
        axes.grid(alpha=0.3)
    if curves:
        memory.legend(fontsize=8, loc="lower right")
    memory.set_ylim(bottom=0)
    machine = ", ".join(f"{name} {version}" for name, version in data["machine"].items())
    save(picture, path, f"measured with {machine}")
    return path


def _ratios(axes: Any, bars: list[dict[str, Any]]) -> None:
    colors = {"yes": _MET, "NO": _MISSED}
    for place, figure in enumerate(reversed(bars)):
        axes.barh(place, figure["ratio"], height=0.6, color=colors[figure["reached"]])
        axes.text(1.04 * figure["ratio"], place, ratio_text(figure["ratio"]), va="center", fontsize=8)
        axes.plot([figure["to_reach"]] * 2, [place - 0.4, place + 0.4], color="black", linewidth=1.5)
    axes.set_yticks(range(len(bars)), [f"{figure['job']}\nagainst {figure['peer']}" for figure in reversed(bars)])
    axes.tick_params(axis="y", labelsize=7)
    axes.set_xscale("log")
    axes.set_xlim(0.3, 5000)
    axes.set_xlabel("times faster than the peer; black: target; orange: target missed")
    axes.axvline(1.0, color="black", linewidth=0.5)
