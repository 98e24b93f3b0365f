"""Trims of JSBSim's 60 aircraft by JSBSim and by this project at the same conditions.

The residuals of this project's trims are measured in JSBSim. The study writes
studies/jsbsim/results.json and a summary into README.md. It requires the package jsbsim and takes
about ten minutes on one core. `--only NAME` studies one aircraft and keeps the other results.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from hfa_jsbsim.reader import data_folder
from hfa_support.files import write_text
from studies.jsbsim.study import LIFTS, SPEEDS, study

RESULTS = Path(__file__).with_name("results.json")
PAGE = Path(__file__).with_name("README.md")
_BEGIN = "<!-- sums of studies.jsbsim -->"
_END = "<!-- end of the sums -->"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and return 0, or return 2 if the package jsbsim is not installed.

    The results are written to results.json, and a summary to README.md.
    """
    parser = argparse.ArgumentParser("python -m studies.jsbsim", description=__doc__)
    parser.add_argument("--only", action="append", default=[], metavar="NAME")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    arguments = parser.parse_args(argv)
    folder = data_folder()
    if folder is None:
        print("studies.jsbsim: install the package jsbsim", file=sys.stderr)
        return 2
    names = sorted(path.name for path in (folder / "aircraft").iterdir() if path.is_dir())
    names = [name for name in names if (folder / "aircraft" / name / f"{name}.xml").is_file()]
    rows: dict[str, Any] = {}
    if RESULTS.is_file():
        rows = {row["aircraft"]: row for row in json.loads(RESULTS.read_text())["aircraft"]}
    chosen = arguments.only or names
    with ProcessPoolExecutor(
        arguments.workers, multiprocessing.get_context("spawn"), max_tasks_per_child=1
    ) as pool:
        for row in pool.map(study, chosen):
            rows[row["aircraft"]] = row
            print(row["aircraft"], *(point["kind"] for point in row["points"]), flush=True)
            ordered = [rows[name] for name in names if name in rows]
            write_text(RESULTS, json.dumps({"aircraft": ordered}, indent=1) + "\n")
    write_page(ordered)
    return 0


def write_page(rows: Sequence[dict[str, Any]]) -> None:
    """Replace the summary of the results in the README of the study."""
    before, _, behind = PAGE.read_text().partition(_BEGIN)
    _, _, after = behind.partition(_END)
    write_text(PAGE, f"{before}{_BEGIN}\n\n{summary(rows)}\n\n{_END}{after}")


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """Return sentences on the number of trimmed aircraft and the residuals."""
    first = [row["points"][: len(SPEEDS)] for row in rows if row["points"]]
    own_points = [row["points"][len(SPEEDS) :] for row in rows if row["points"]]
    residuals = [
        point["residual"] for row in rows for point in row["points"] if "residual" in point
    ]

    def count(groups: list[list[dict[str, Any]]], kinds: tuple[str, ...]) -> int:
        return sum(any(point["kind"] in kinds for point in points) for points in groups)

    jsbsim = sum(any(point["jsbsim"] for point in points) for points in first)
    small = sum(residual < 1e-9 for residual in residuals)
    return (
        f"Of {len(rows)} aircraft JSBSim's own trim finds one at {jsbsim}, `hfa` at"
        f" {count(first, ('level', 'glide'))} ({count(first, ('level',))} in level flight); with"
        f" {len(LIFTS)} speeds of their own (lift coefficients {', '.join(map(str, LIFTS))}) at"
        f" {count(own_points, ('level', 'glide'))} ({count(own_points, ('level',))} level). Of"
        f" {len(residuals)} trims that were measured in JSBSim, {small} leave accelerations below"
        " 1e-9 ft/s² and rad/s²."
    )


if __name__ == "__main__":
    raise SystemExit(main())
