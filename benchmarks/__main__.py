"""Run every benchmark, print the table, store it."""

from __future__ import annotations

import importlib
import sys

from benchmarks import report

JOBS = ("jobs_trim", "jobs_gare")


def main() -> int:
    """All jobs, or those named on the command line."""
    rows = []
    for job in sys.argv[1:] or JOBS:
        print(f"{job} ...", file=sys.stderr, flush=True)
        rows += importlib.import_module(f"benchmarks.{job}").rows()
    print(report.text(rows))
    if not sys.argv[1:]:
        print(f"stored in {report.store(rows)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
