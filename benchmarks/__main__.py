"""Run the benchmarks, print the table, store and draw it: `python -m benchmarks [--quick]
[subjects]`.

--quick runs everything at a toy size to see that it works; its figures mean nothing and are not
stored. Subjects named on the command line are run alone and replace their own figures among the
stored ones."""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from benchmarks import report

SUBJECTS = ("models", "flight", "scale", "jsbsim")


def main(words: list[str] | None = None) -> int:
    """All subjects, or those named."""
    parser = argparse.ArgumentParser("benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="toy sizes, nothing stored")
    parser.add_argument(
        "subjects", nargs="*", metavar="subject", help=f"of {', '.join(SUBJECTS)}; default all"
    )
    arguments = parser.parse_args(words)
    if unknown := set(arguments.subjects) - set(SUBJECTS):
        parser.error(f"no subject {min(unknown)!r}; choose from {', '.join(SUBJECTS)}")
    rows = {}
    for subject in arguments.subjects or SUBJECTS:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as apart:
            # in a process of its own: the threads and memory of one subject slow no other
            rows[subject] = apart.submit(report.rows_of, subject, arguments.quick).result()
    print(report.markdown([report.figure(row) for some in rows.values() for row in some]))
    if not arguments.quick:
        print(f"stored in {report.RESULTS} and {report.draw(report.store(rows, SUBJECTS))}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
