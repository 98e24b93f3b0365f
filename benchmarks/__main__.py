"""Run the benchmarks three times and publish the table: `python -m benchmarks [--quick] [names]`.

The table is printed, stored, drawn and written into the documents. --quick tests the benchmarks: it
runs each job once at a toy size and stores nothing. Names select single jobs, or all jobs of a
subject. Only the stored figures of the selected jobs are replaced. Nothing is stored if the
others were measured on another machine or with other versions. After an interruption the finished
runs are kept.
"""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks import report
from hfa_support.errors import BadInputError

#: Number of runs. The row with the median ratio is stored, with the smallest and largest ratio.
_RUNS = 3


def main(words: list[str] | None = None) -> int:
    """Run the named jobs, or all jobs, and return the exit code.

    The exit code is 0, or 1 if no run was finished.

    words: arguments of the command line, None for those in `sys.argv`
    """
    choices = [*report.SUBJECTS, *report.jobs()]
    parser = argparse.ArgumentParser("benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="run at toy sizes and store nothing")
    parser.add_argument(
        "names",
        nargs="*",
        metavar="name",
        help=f"jobs or subjects to run: {', '.join(choices)}; default: all",
    )
    arguments = parser.parse_args(words)
    if unknown := set(arguments.names) - set(choices):
        parser.error(f"no job {min(unknown)!r}; choose from {', '.join(choices)}")
    runs: list[report.Results] = []
    try:
        for number in range(1, 2 if arguments.quick else _RUNS + 1):
            runs.append(_run(_selected(arguments.names), number, arguments.quick))
    except KeyboardInterrupt:
        print(f"interrupted: {len(runs)} runs are finished", file=sys.stderr)
    if not runs:
        return 1
    print(report.markdown(report.figures(runs)))
    print(report.growth_markdown(report.growths(runs)))
    if not arguments.quick:
        try:
            data = report.store(runs)
        except BadInputError as error:
            print(f"error: {error}", file=sys.stderr)
            return 2
        report.show(data)
        print(f"stored in {report.RESULTS} and {report.draw(data)}")
    return 0


def _run(names: list[str], number: int, quick: bool) -> report.Results:
    """Return job -> comparisons and measurements; growing jobs run only the first time."""
    rows: dict[str, list[report.Row | report.Growth]] = {}
    for name in names:
        if number > 1 and name in report.SUBJECTS["scale"]:
            rows[name] = []
            continue
        start = time.perf_counter()
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
            # A separate process keeps the threads and memory of one job from slowing another.
            rows[name] = apart.submit(report.rows_of, name, quick).result()
        print(f"run {number}, {name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    return rows


def _selected(names: list[str]) -> list[str]:
    """Return the names of the selected jobs, in the order of the table."""
    jobs = report.jobs()
    return [job for job, subject in jobs.items() if not names or {job, subject} & set(names)]


if __name__ == "__main__":
    raise SystemExit(main())
