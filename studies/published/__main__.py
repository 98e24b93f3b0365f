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
from hfa_printed.printed_file import PrintedFile, load_printed
from hfa_printed.printed_verdict import check_printed
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.files import write_text
from hfa_support.reporting.report import markdown_table
from hfa_support.reporting.text import Table
from verification import regenerate_all

SOURCES = Path(__file__).parent / "sources"
PAGE = Path(__file__).parents[2] / "docs" / "published.md"

HEADER = ("file", "verdict", "text", "plant")
#: How the verdict begins where every digit is right.
RIGHT = "as printed"
_HEAD = """# Printed answers of others

Judge an answer that a paper, a manual or a repository prints beside its plant:

```console
$ hfa printed studies/published/sources/radp_suspension.toml
as printed: all 20 entries
...
```

[Each verdict](critics.md#a-printed-answer) is about digits: that an answer belongs to another plant
says nothing about how it came there. Each row is a file of
[studies/published/sources](../studies/published/sources), which names the text that was opened
(repository, path and commit, or address and date), what was worked out, and the numbers, digit by
digit. `python -m studies.published` judges all files and writes this page. A text that prints an
answer without its plant stays out.
"""


class Row(NamedTuple):
    """An answer judged.

    name: of its file
    verdict: one line, its class before the colon
    text: the title of the text that prints it
    plant: its time, its numbers of states, inputs and disturbances
    """

    name: str
    verdict: str
    text: str
    plant: str


def row_of(path: Path) -> Row:
    """The row of a file. BadInputError where the file does not say its source."""
    file = load_printed(path)
    if not file.source:
        raise BadInputError(f"{path}: source is missing; say which text was opened")
    try:
        verdict = check_printed(path).report().title
    except NoSolutionError as error:
        verdict = f"no exact answer: {error}"
    return Row(path.stem, verdict, file.title, _plant_text(file))


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
                verdict=f"{right} of {len(errors)} entries of A and B as regenerated, the farthest"
                f" {max(errors):.2f} half units off; the paper prints no P, K or W",
                text=f"Zhang, Ma, Zhang, Wu 2026, flexible aircraft at {angle}; Section 5.1",
                plant="continuous 6, 5, 6",
            )
        )
    return rows


def page_of(rows: list[Row]) -> str:
    """docs/published.md: how many answers have each verdict, then those that are not as printed."""
    counts = Counter(row.verdict.partition(":")[0] for row in rows)
    others = [row for row in rows if not row.verdict.startswith(RIGHT)]
    right = [row for row in rows if row.verdict.startswith(RIGHT)]
    parts = [
        _HEAD,
        markdown_table(Table(("verdict", "files"), counts.most_common())),
        "\nPlant: numbers of states, inputs and disturbances.",
    ]
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
    time = "discrete" if plant.is_discrete else "continuous"
    text = f"{time} {states}, {inputs}, {disturbances}"
    return text if plant.discount == 1.0 else f"{text}, discount {plant.discount:g}"


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
    for row in rows:
        print(f"{row.name}: {row.verdict}")


if __name__ == "__main__":
    main()
