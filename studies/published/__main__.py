"""Compare each printed digit of published solutions with the exact solutions of their plants.

python -m studies.published         checks all files in `sources/`, and writes results.csv and
                                    README.md
python -m studies.published FILE    prints the report on one file
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from hfa.options.output import ProgressLine
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import write_text
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table
from studies.published.printed_file import PrintedFile, load_printed
from studies.published.verdict import check_printed

SOURCES = Path(__file__).parent / "sources"
RESULTS = Path(__file__).with_name("results.csv")
PAGE = Path(__file__).with_name("README.md")

_HEAD = """# Verdicts on published solutions

`python -m studies.published FILE.toml` compares each printed digit of a published solution with
the solution computed for the published plant. An entry of a matrix may be a formula such as
`-m*g/l` of values in the table `[parameters]`. Entries of the plant without a decimal point are
assumed to be exact.

```toml
title = "Two states"
time = "continuous"             # or "discrete", with discount = "0.9"
[plant]                         # A, B, Q, R; optionally N; for a game, E and gamma
A = "-1.0189 0.9051; 0.8232 -1.0774"
B = "0.3127; 1.4586"
Q = "diag 1 2"
R = "1"
[printed]                       # P, K, L, W (basis = "quadratic") or H (discrete, over x, u, w)
P = "0.55052 0.23872; 0.23872 0.64718"
K = "0.52034 1.01862"
K_sign = "u = -K x"
```

```console
$ python -m studies.published studies/published/sources/radp_suspension.toml
as printed: all 20 entries
...
```

`python -m studies.published` checks all [files with published solutions](sources) and writes a
[verdict for each file](results.csv). The table shows the number of files with each verdict.

| verdict | exit code | condition |
|---|---|---|
| as printed | 0 | every entry agrees within half a unit of its last printed digit |
| cut off | 0 | the digits are truncated instead of rounded |
| one entry of the answer | 1 | exactly one entry of the published solution differs |
| the answer belongs to another plant | 1 | one misprint of the plant explains every digit |
| wrong | 1 | a known mistake explains the differences, or no explanation is found |
| not decided | 1 | `plant_rounded = true`, and rounding of the plant explains the differences |
| close | 1 | `learned = true`, and none of the above |
| cannot tell | 1 | the relative error exceeds 50 %, or P or H is not symmetric |
| no exact answer | 1 | the published plant has no certified solution |

"""


class Row(NamedTuple):
    """The result for one published solution.

    name: name of the file with the solution
    verdict: one line, which begins with the class of the verdict and a colon
    text: title of the publication
    plant: kind of time, and numbers of states, inputs and disturbances
    """

    name: str
    verdict: str
    text: str
    plant: str


def row_of(path: Path) -> Row:
    """Check the solution in a file and return its result.

    Raises BadInputError if the file does not state its source.
    """
    file = load_printed(path)
    if not file.source:
        raise BadInputError(f"{path}: source is missing; name the publication")
    try:
        verdict = check_printed(path).report().title
    except NoSolutionError as error:
        verdict = f"no exact answer: {error}"
    return Row(path.stem, verdict, file.title, _plant_text(file))


def results_of(rows: list[Row]) -> str:
    """Return the content of results.csv: a header and a line for each result."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(Row._fields)
    writer.writerows(rows)
    return out.getvalue()


def load_results() -> list[Row]:
    """Return the results in results.csv."""
    with RESULTS.open(encoding="utf-8", newline="") as file:
        return [Row(**line) for line in csv.DictReader(file)]


def page_of(rows: list[Row]) -> str:
    """Return the text of README.md, with the number of solutions for each verdict."""
    counts = Counter(row.verdict.partition(":")[0] for row in rows)
    parts = [
        _HEAD,
        markdown_table(Table(("verdict", "files"), counts.most_common())),
    ]
    return "\n".join(parts) + "\n"


def _plant_text(file: PrintedFile) -> str:
    plant = file.plant
    states, inputs = plant.B.shape
    disturbances = plant.E.shape[1]
    time = "discrete" if plant.is_discrete else "continuous"
    text = f"{time} {states}, {inputs}, {disturbances}"
    return text if plant.discount == 1.0 else f"{text}, discount {plant.discount:g}"


def main(argv: Sequence[str] | None = None) -> int:
    """Check the given file and print its report, or check all files and write the results.

    The exit code is 0 if every digit of the file is right, or if all files were checked, 1 if a
    digit is wrong or the plant has no certified solution, and 2 for bad input.
    """
    parser = argparse.ArgumentParser(
        "python -m studies.published",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", nargs="?", type=Path, help="TOML file with a published solution")
    file = parser.parse_args(argv).file
    if file is None:
        check_all()
        return 0
    try:
        verdict = check_printed(file, ProgressLine("compare"))
    except (BadInputError, NoSolutionError) as error:
        print(f"published: {error}", file=sys.stderr)
        return 2 if isinstance(error, BadInputError) else 1
    print(verdict.report())
    return 0 if verdict.ok else 1


def check_all() -> None:
    """Check all published solutions, write results.csv and README.md, and print the
    verdicts.
    """
    paths = sorted(SOURCES.glob("*.toml"))
    progress = ProgressLine("judge")
    rows = []
    for count, path in enumerate(paths, start=1):
        rows.append(row_of(path))
        progress(count, len(paths))
    write_text(RESULTS, results_of(rows))
    write_text(PAGE, page_of(rows))
    for row in rows:
        print(f"{row.name}: {row.verdict}")


if __name__ == "__main__":
    sys.exit(main())
