"""Judges the printed answers of the folder `sources/` and writes docs/published.md:

python -m studies.published
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import hfa_model
from hfa.output import ProgressLine
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import write_text
from hfa_support.reporting.report import markdown_table
from hfa_support.reporting.text import Table, columns
from verification import regenerate_all
from verification.printed.printed_file import PrintedFile, load_printed
from verification.printed.printed_verdict import check_printed

SOURCES = Path(__file__).parent / "sources"
PAGE = Path(__file__).parents[2] / "docs" / "published.md"

HEADER = ("file", "source", "plant", "printed", "verdict")
#: How the verdict begins where every digit is right.
RIGHT = "as printed"
_HEAD = """# Printed answers of others

`python -m studies.published` judges answers that papers, manuals and repositories print beside
their plant, and writes this page. Each row is a file of
[studies/published/sources](../studies/published/sources), which names the text that was opened; its
numbers are copied as they stand there. [Each verdict](critics.md#a-printed-answer) is about digits:
that an answer belongs to another plant says nothing about how it came there.

One file alone:

```console
$ hfa verify --printed studies/published/sources/radp_suspension.toml
as printed: all 20 entries
...
```

To add a row, copy a file of the folder and paste the numbers, digit by digit, of a text that is
open in front of you. `source` says where it is: repository, path and commit, or address and date.
`note` says what was worked out, such as entries of A from printed masses. Then run
`python -m studies.published`. A text that prints an answer without its plant stays out.
"""


class Row(NamedTuple):
    """An answer judged.

    name: of its file
    source: title, and where it is printed
    plant: its time and its sizes
    printed: the names of the blocks
    verdict: one line, its class before the colon
    """

    name: str
    source: str
    plant: str
    printed: str
    verdict: str


def row_of(path: Path) -> Row:
    """The row of a file. BadInputError where the file does not say its source."""
    file = load_printed(path)
    if not file.source:
        raise BadInputError(f"{path}: source is missing; say which text was opened")
    try:
        verdict = check_printed(path).report().title
    except NoSolutionError as error:
        verdict = f"no exact answer: {error}"
    if file.note and not verdict.startswith(RIGHT):
        verdict = f"{verdict} ({file.note})"
    source = f"{file.title}; {file.source}"
    return Row(path.stem, source, _plant_text(file), ", ".join(file.answer), verdict)


def rows_of_the_paper() -> list[Row]:
    """The two plants of the paper, which prints no P, K or W: A and B beside the regenerated."""
    rows = []
    for pair in regenerate_all(hfa_model.aircraft()).pairs:
        angle = f"{pair.published.dihedral_deg:g} deg"
        errors = [abs(entry.half_units) for entry in pair.entries if not entry.is_zero]
        right = sum(error <= 1.0 for error in errors)
        rows.append(
            Row(
                name="`hfa regenerate`",
                source=f"Zhang, Ma, Zhang, Wu 2026, flexible aircraft at {angle}; Section 5.1",
                plant="continuous, 6 states, 5 inputs, 6 disturbances",
                printed="A, B",
                verdict=f"{right} of {len(errors)} entries as regenerated, the farthest"
                f" {max(errors):.2f} half units off; the paper prints no P, K or W",
            )
        )
    return rows


def page_of(rows: list[Row]) -> str:
    """docs/published.md: how many answers have each verdict, then those that are not as printed."""
    counts = Counter(row.verdict.partition(":")[0] for row in rows)
    others = [row for row in rows if not row.verdict.startswith(RIGHT)]
    right = [row for row in rows if row.verdict.startswith(RIGHT)]
    parts = [_HEAD, markdown_table(Table(("verdict", "files"), counts.most_common()))]
    for title, group in (
        ("Not as printed", others),
        ("As printed", right),
        ("The aircraft of the paper", rows_of_the_paper()),
    ):
        parts += [f"\n## {title}\n", markdown_table(Table(HEADER, group))]
    return "\n".join(parts) + "\n"


def _plant_text(file: PrintedFile) -> str:
    plant = file.plant
    states, inputs = plant.B.shape
    disturbances = plant.E.shape[1]
    parts = ["discrete" if plant.is_discrete else "continuous"]
    for count, noun in ((states, "state"), (inputs, "input"), (disturbances, "disturbance")):
        if count:
            parts.append(f"{count} {noun}{'s' if count > 1 else ''}")
    if plant.discount != 1.0:
        parts.append(f"discount {plant.discount:g}")
    return ", ".join(parts)


def main() -> None:
    """Print the table and write the page."""
    argparse.ArgumentParser("python -m studies.published", description=__doc__).parse_args()
    paths = sorted(SOURCES.glob("*.toml"))
    progress = ProgressLine("judge")
    rows = []
    for count, path in enumerate(paths, start=1):
        rows.append(row_of(path))
        progress(count, len(paths))
    write_text(PAGE, page_of(rows))
    shown = [(row.name, row.plant, row.printed, row.verdict) for row in rows]
    print(columns(("file", "plant", "printed", "verdict"), shown))


if __name__ == "__main__":
    main()
