"""Run the benchmarks, print the table, store and draw it: `python -m benchmarks [--quick] [names]`.

--quick runs everything at a toy size to see that it works; its figures mean nothing and are not
stored. Jobs, or subjects with all their jobs, that are named on the command line are run alone and
replace their own figures among the stored ones."""

from __future__ import annotations

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks import report


def main(words: list[str] | None = None) -> int:
    """All jobs, or those named."""
    choices = [*report.SUBJECTS, *report.jobs()]
    parser = argparse.ArgumentParser("benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="toy sizes, nothing stored")
    parser.add_argument(
        "names", nargs="*", metavar="name", help=f"of {', '.join(choices)}; default all"
    )
    arguments = parser.parse_args(words)
    if unknown := set(arguments.names) - set(choices):
        parser.error(f"no job {min(unknown)!r}; choose from {', '.join(choices)}")
    rows = {}
    for name in _asked(arguments.names):
        start = time.perf_counter()
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
            # in a process of its own: the threads and memory of one job slow no other
            rows[name] = apart.submit(report.rows_of, name, arguments.quick).result()
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr)
    print(report.markdown([report.figure(row) for some in rows.values() for row in some]))
    if not arguments.quick:
        print(f"stored in {report.RESULTS} and {report.draw(report.store(rows))}")
    return 0


def _asked(names: list[str]) -> list[str]:
    """The jobs of these names and subjects, in the order of the table; all without names."""
    jobs = report.jobs()
    return [job for job, subject in jobs.items() if not names or {job, subject} & set(names)]


if __name__ == "__main__":
    raise SystemExit(main())
