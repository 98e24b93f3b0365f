"""The table of trims: what was asked of each, as what it counts, and what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hfa_support.reporting.rows import Sheet, matrix_of
from hfa_support.reporting.text import Table
from trim.point.condition import stated_cells, stated_values
from trim.point.operating_point import OperatingPoint
from trim.point.status import DOUBTED, FREE, LIMIT, RESULTS, STALLED, TRIMMED, UNTRIMMED


def result_of(sheet: Sheet) -> str:
    """Return the result of a trim by its sheet: "no trim", "stalled", "doubted" or "trimmed"."""
    names = {row.name for row in sheet}
    for row, result in (("failure", UNTRIMMED), ("stalled", STALLED), ("doubts", DOUBTED)):
        if row in names:
            return result
    return TRIMMED


def asked_of(point: OperatingPoint) -> dict[str, Any]:
    """Return the cells that state the condition of a point: values, free variables, limits."""
    model = point.model
    stated = stated_values(point.trim_problem.asked)
    changed = {
        name: model.parameters[name].start for name in model.changed if name not in stated.free
    }
    return stated_cells(model, stated._replace(held={**stated.held, **changed}))


def matrix(asked: Sequence[Mapping[str, Any]], sheets: Sequence[Sheet]) -> Table:
    """Return the table of trims: what was asked, the column `results`, and what was found.

    A file of conditions may be this table: its columns before `results` state the conditions.

    asked: heading -> cell that states a part of a condition, for each trim (`stated_cells`)
    """
    found = matrix_of(sheets)
    headings = [*dict.fromkeys(heading for cells in asked for heading in cells)]
    last = [each for each in (FREE, LIMIT) if each in headings]
    headings = [each for each in headings if each not in last] + last
    worst = [{row.name: row.note for row in sheet}.get("worst level", "") for sheet in sheets]
    rows = [
        (*(cells.get(heading, "") for heading in headings), result_of(sheet), *row, qualities)
        for cells, sheet, row, qualities in zip(asked, sheets, found.rows, worst, strict=True)
    ]
    return Table((*headings, RESULTS, *found.header, "qualities of the worst level"), rows)
