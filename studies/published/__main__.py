"""Check the published solutions in `sources/`, and write results.csv and docs/published.md.

python -m studies.published
"""

from __future__ import annotations

import argparse
import csv
import io
from collections import Counter
from pathlib import Path
from typing import NamedTuple

from hfa.options.output import ProgressLine
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import write_text
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table
from verification.printed.printed_file import PrintedFile, load_printed
from verification.printed.verdict import check_printed

SOURCES = Path(__file__).parent / "sources"
RESULTS = Path(__file__).with_name("results.csv")
PAGE = Path(__file__).parents[2] / "docs" / "published.md"

_HEAD = """# Verdicts on published solutions

`hfa printed` compares each printed digit of a published solution with the solution computed for
the published plant:

```console
$ hfa printed studies/published/sources/radp_suspension.toml
as printed: all 20 entries
...
```

`python -m studies.published` checks all [files with published
solutions](../studies/published/sources) and writes a [verdict for each
file](../studies/published/results.csv). The table shows the number of files with each
[verdict](critics.md#a-printed-solution). `no exact answer` means that the published plant has no
certified solution.
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
    """Return the text of docs/published.md, with the number of solutions for each verdict."""
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


def main() -> None:
    """Check all published solutions, write results.csv and docs/published.md, and print the
    verdicts.
    """
    argparse.ArgumentParser("python -m studies.published", description=__doc__).parse_args()
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
    main()
