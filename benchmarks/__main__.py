"""Run every benchmark, print the table, store it, draw it: `python -m benchmarks [--quick] [sets]`.

--quick runs everything at a toy size to see that it works; its figures mean nothing and are not stored. Sets of jobs
named on the command line are run alone, and replace their own figures among the stored ones.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from benchmarks import report
from benchmarks.sets import SETS, rows_of


def main(words: Sequence[str] | None = None) -> int:
    """All sets of jobs, or those named."""
    words = sys.argv[1:] if words is None else words
    quick = "--quick" in words
    names = [word for word in words if word != "--quick"]
    unknown = [name for name in names if name not in SETS]
    if unknown:
        print(f"benchmarks: no set {unknown[0]!r}; choose from {', '.join(SETS)}, or --quick", file=sys.stderr)
        return 2
    rows = {}
    for name in names or SETS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        rows[name] = rows_of(name, quick)
    print(report.text([row for some in rows.values() for row in some]))
    if not quick:
        from benchmarks.picture import draw

        print(f"stored in {report.RESULTS} and {draw(report.store(rows, SETS))}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
