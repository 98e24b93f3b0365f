"""Measure how fast this project is: `python -m benchmarks [--quick] [NAME ...]`.

Each job is timed in turn with the same work of another tool, and its rows are printed. The rows of
all jobs are written into benchmarks/README.md. --quick runs each job once at a toy size.
"""

from __future__ import annotations

import argparse
import os
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks import jobs, report


def main(words: list[str] | None = None) -> int:
    """Run the named jobs, or all jobs, and return the exit code.

    words: arguments of the command line, None for those in `sys.argv`
    """
    parser = argparse.ArgumentParser("benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="run at toy sizes and store nothing")
    names = ", ".join(jobs.JOBS)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"jobs to run: {names}")
    arguments = parser.parse_args(words)
    if unknown := set(arguments.names) - set(jobs.JOBS):
        parser.error(f"no job {min(unknown)!r}; choose from {names}")
    measured: dict[str, list[report.Comparison]] = {}
    loads = []
    for name in arguments.names or jobs.JOBS:
        loads.append(os.getloadavg()[0])
        # A separate process keeps the threads and memory of one job from slowing another.
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
            measured[name] = apart.submit(jobs.JOBS[name], arguments.quick).result()
        print(report.markdown(measured[name]), flush=True)
    if not (arguments.quick or arguments.names):
        report.store(measured, loads)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
