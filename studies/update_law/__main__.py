"""Results of the paper's update law in every setting of the study, printed as a table.

README.md contains the table and states the causes of the results. The study takes about a minute on
two cores. It writes FOLDER/published_study.json with every run, and each finished row to
FOLDER/rows.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hfa import BadInputError, NoSolutionError
from hfa_support.files import write_text
from hfa_support.reporting.data_files import json_text
from studies.finished import finished, stamped
from studies.update_law.study import ROWS, SCHEMA, made, planned, references, summed_up

_HEADER = (
    "row,runs,overflow,stabilizing,certified,by rounding,error of P,error of K,settled s,λ₀,largest"
    " explicit step s"
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and return the exit code.

    - 0: finished, even if the law fails in some runs
    - 1: there is no reference solution
    - 2: bad usage or input
    """
    parser = argparse.ArgumentParser("python -m studies.update_law", description=__doc__)
    about = "only rows whose name contains TEXT; repeatable; default: all"
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help=about)
    parser.add_argument(
        "-o",
        type=Path,
        default=Path("out/update_law"),
        metavar="FOLDER",
        help="default: %(default)s",
    )
    parser.add_argument("--resume", action="store_true", help="reuse finished rows in FOLDER/rows")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count(), metavar="N", help="default: one per core"
    )
    arguments = parser.parse_args(argv)
    names = [
        name for name in ROWS if not arguments.only or any(text in name for text in arguments.only)
    ]
    if not names:
        parser.error(
            f"no row's name contains {' or '.join(arguments.only)}; there are: {'; '.join(ROWS)}"
        )
    try:
        rows = study(names, arguments.o, resume=arguments.resume, workers=arguments.workers)
    except (BadInputError, NoSolutionError) as error:
        print(f"update_law: {error}", file=sys.stderr)
        return 2 if isinstance(error, BadInputError) else 1
    print(table(rows), *(f"{row['name']}: {row['cause']}" for row in rows), sep="\n")
    return 0


def study(
    names: Sequence[str], folder: Path, *, resume: bool = False, workers: int = 1
) -> list[dict[str, Any]]:
    """Return the rows of the study, and write them to folder/published_study.json.

    Each new row is written to folder/rows when it is finished.

    names: names of the rows
    resume: whether to reuse finished rows
    workers: number of processes
    """
    (folder / "rows").mkdir(parents=True, exist_ok=True)
    of = references()
    rows = []
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        for name in names:
            words = "".join(letter if letter.isalnum() else " " for letter in name).split()
            path = folder / "rows" / f"{'-'.join(words)}.json"
            runs = planned(name, of)
            decided = {
                "row": name,
                "runs": [(one.dihedral_deg, case, asdict(chosen)) for one, case, chosen in runs],
            }
            known = finished(path, decided) if resume else None
            if known is None:
                print(f"update_law: {name}", file=sys.stderr)
                done = list(pool.map(made, *zip(*runs, strict=True)))
                known = stamped({"row": summed_up(name, done)}, decided)
                write_text(path, json_text(known))
            rows.append(known["row"])
    write_text(folder / "published_study.json", json_text({"schema": SCHEMA, "rows": rows}))
    return rows


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return a Markdown table with one line for each row of the study.

    A line contains counts, and the smallest and the largest number of each kind over the runs.
    """
    header = _HEADER.split(",")
    lines = [header, ["---"] * len(header)]
    for row in rows:
        counts = [
            row[name]
            for name in ("count", "overflow", "stabilizing", "certified", "decided_by_rounding")
        ]
        numbers = ("P_error", "K_error", "settled", "lambda_0", "explicit_step_limit")
        cells = ["-" if count is None else str(count) for count in counts]
        lines.append([row["name"], *cells, *(_range(row, name) for name in numbers)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _range(row: dict[str, Any], name: str) -> str:
    if row["count"] == row["overflow"] and name not in ("lambda_0", "explicit_step_limit"):
        return "-"
    return " to ".join(
        dict.fromkeys("never" if value is None else f"{value:.2g}" for value in row["ranges"][name])
    )


if __name__ == "__main__":
    sys.exit(main())
