"""Cost of policies of PPO, A2C, SAC and TD3 above the best flight found, for seven aircraft.

The study trains policies with the default settings of Stable-Baselines3. Each policy and the
saturated LQR are simulated from the initial conditions of the best flights. The results are written
to FOLDER/gap.json and FOLDER/gap.png. Results of an earlier run are reused. The study takes hours
and requires the extra ".[training]" and the package jsbsim.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa.options.output import ProgressLine
from hfa_support.files import write_text
from hfa_support.reporting.data_files import json_text
from hfa_support.reporting.figure import new_figure, save
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from studies.finished import finished, stamped
from studies.gap.judging import SEED, STARTS, flight_results
from studies.gap.tasks import SAMPLE_TIME, TASKS, Task
from studies.gap.training import BUDGETS, SECONDS, Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADER = (
    "aircraft",
    "policy",
    "stay",
    "end at trim",
    "cost over best, median",
    "worst",
    "over LQR, median",
    "unstable at ms",
)


def runs_of(
    tasks: Iterable[Task], algorithms: Sequence[str], seeds: int, folder: Path
) -> list[Run]:
    """Return the training runs of all aircraft, algorithms and seeds, ordered by seed.

    seeds: number of seeds, which begin at 1
    folder: folder of the study
    """
    return [
        Run(task, algorithm, seed, folder / "policies")
        for seed in range(1, seeds + 1)
        for algorithm in algorithms
        for task in tasks
    ]


def train_missing(runs: Sequence[Run]) -> None:
    """Train the policies that no earlier run has trained, and print a line for each."""
    for number, run in enumerate(runs, start=1):
        if run.trained() is None:
            record = run.train()
            seconds = record["processor_seconds"]
            print(f"{number} of {len(runs)}: {run.name}, {seconds:.0f} s", flush=True)


def stored_results(task: Task, runs: Sequence[Run], folder: Path) -> dict[str, Any]:
    """Return the results of the flights of all trained policies of an aircraft.

    Stored results are reused if the policy files and the settings are unchanged.
    """
    found = [(run, run.trained()) for run in runs]
    trained = [(run, record) for run, record in found if record is not None]
    decides = {
        "aircraft": task.aircraft,
        "policies": [record["policy_sha256"] for _, record in trained],
        "starts": STARTS,
        "seed": SEED,
    }
    path = folder / "judged" / f"{task.name.replace('/', ' ')}.json"
    known = finished(path, decides)
    if known is None:
        progress = ProgressLine(f"flights of {task.name}")
        content = flight_results(task, [run for run, _ in trained], progress)
        for policy, (_, record) in zip(content["policies"], trained, strict=True):
            policy["steps"] = record["steps"]
            policy["sha256"] = record["policy_sha256"]
        known = stamped(content, decides)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json_text(known))
    return known


def rows_of(aircraft: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the table rows of an aircraft: one for the LQR, then one for each algorithm.

    The row of an algorithm summarizes the training runs of all seeds.
    """
    starts = aircraft["starts"]
    rows = [_row(aircraft["aircraft"], "LQR, saturated", [aircraft["lqr"]], starts)]
    for algorithm in BUDGETS:
        of_algorithm = [each for each in aircraft["policies"] if each["algorithm"] == algorithm]
        if of_algorithm:
            seeds = "1 seed" if len(of_algorithm) == 1 else f"{len(of_algorithm)} seeds"
            rows.append(_row("", f"{algorithm}, {seeds}", of_algorithm, starts))
    return rows


def _row(
    name: str, policy: str, summaries: Sequence[dict[str, Any]], starts: int
) -> tuple[str, ...]:
    whole = starts * len(summaries)
    delays = [each.get("first_unstable_delay") for each in summaries]
    known = [f"{1e3 * delay:.0f}" for delay in delays if delay is not None]
    return (
        name,
        policy,
        f"{sum(each['stay'] for each in summaries)} of {whole}",
        f"{sum(each['end_at_trim'] for each in summaries)} of {whole}",
        _over(summaries, "over_best", "median"),
        _over(summaries, "over_best", "worst"),
        _over(summaries, "over_lqr", "median"),
        ", ".join(known) or "-",
    )


def _over(summaries: Sequence[dict[str, Any]], key: str, which: str) -> str:
    """Return a cost ratio of one algorithm over all its training runs, as text."""
    values = [each[key][which] for each in summaries if each[key] is not None]
    if not values:
        return "-"
    return f"{np.median(values) if which == 'median' else max(values):.3g}"


def drawn(aircraft: Sequence[dict[str, Any]]) -> Figure:
    """Return a figure of each policy's median cost relative to the best flight, with a row per
    aircraft.

    A policy that always leaves the envelope is drawn at the right edge.
    """
    figure = new_figure(9.0, 5.5)
    axes = figure.subplots()
    names = [each["aircraft"] for each in aircraft]
    edge = 2.0 * max(
        (
            each["over_best"]["median"]
            for one in aircraft
            for each in one["policies"]
            if each["over_best"] is not None
        ),
        default=10.0,
    )
    for place, algorithm in enumerate(BUDGETS):
        ends, never = [], []
        for row, one in enumerate(aircraft):
            for each in one["policies"]:
                if each["algorithm"] != algorithm:
                    continue
                height = row + 0.15 * (place - 1.5)
                if each["over_best"] is None:
                    never.append((edge, height))
                else:
                    ends.append((each["over_best"]["median"], height))
        color = f"C{place}"
        axes.scatter(*np.array(ends or [(np.nan, np.nan)]).T, color=color, label=algorithm)
        axes.scatter(*np.array(never or [(np.nan, np.nan)]).T, color=color, marker="x")
    axes.scatter([], [], color="black", marker="x", label="no flight stays within the envelope")
    lqr = [
        np.nan if one["lqr"]["over_best"] is None else one["lqr"]["over_best"]["median"]
        for one in aircraft
    ]
    axes.scatter(lqr, range(len(names)), color="black", marker="|", s=200, label="LQR, saturated")
    axes.set_xscale("log")
    axes.set_yticks(range(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("median cost of a policy's flights over the best found (1 is the best)")
    axes.grid(axis="x", alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, title="policy, a mark for each training run")
    return figure


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, write its files, print the table and return 0."""
    parser = argparse.ArgumentParser("python -m studies.gap", description=__doc__)
    folder_help = "default: %(default)s"
    parser.add_argument(
        "-o", type=Path, default=Path("out/gap"), metavar="FOLDER", help=folder_help
    )
    parser.add_argument("--seeds", type=int, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument("--algorithms", nargs="+", choices=tuple(BUDGETS), default=tuple(BUDGETS))
    parser.add_argument(
        "--judge-only", action="store_true", help="simulate trained policies only, without training"
    )
    arguments = parser.parse_args(argv)
    folder = arguments.o
    runs = runs_of(TASKS, arguments.algorithms, arguments.seeds, folder)
    if not arguments.judge_only:
        train_missing(runs)
    aircraft = [
        stored_results(task, [run for run in runs if run.task == task], folder) for task in TASKS
    ]
    data = {
        "sample_time": SAMPLE_TIME,
        "episode_seconds": SECONDS,
        "steps": {algorithm: steps for algorithm, (steps, _) in BUDGETS.items()},
        "aircraft": aircraft,
    }
    write_text(folder / "gap.json", json_text(data))
    save(drawn(aircraft), folder / "gap.png")
    rows = [row for one in aircraft for row in rows_of(one)]
    title = "Trained policies compared with the best flights found"
    print(Report(title, (Table(HEADER, rows),)).text())
    return 0


if __name__ == "__main__":
    sys.exit(main())
