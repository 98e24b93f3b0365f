"""The table of trims: what was asked of each, as what it counts, and what was found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from hfa_aircraft.model import Model
from hfa_support.reporting.rows import Row, Sheet, matrix_of
from hfa_support.reporting.text import Table
from trim.point.condition import stated_values, typed_limits
from trim.point.operating_point import OperatingPoint
from trim.point.status import DOUBTED, FREE, LIMIT, NAME, RESULTS, STALLED, TRIMMED, UNTRIMMED


def result_of(sheet: Sheet) -> str:
    """Return the result of a trim by its sheet: "no trim", "stalled", "doubted" or "trimmed"."""
    names = {row.name for row in sheet}
    for row, result in (("failure", UNTRIMMED), ("stalled", STALLED), ("doubts", DOUBTED)):
        if row in names:
            return result
    return TRIMMED


def asked_of(point: OperatingPoint) -> Sheet:
    """Return the rows that state the condition of a point: values, free variables, limits."""
    model = point.model
    held, free, limits = stated_values(point.trim_problem.asked)
    changed = {name: model.parameters[name].start for name in model.changed}
    return asked_sheet(model, {**held, **changed}, free, limits)


def asked_sheet(
    model: Model,
    held: Mapping[str, float],
    free: Sequence[str],
    limits: Mapping[str, tuple[float, float]],
    name: str = "",
) -> Sheet:
    """Return the rows that state a condition.

    held: variable, rate or parameter -> value
    free: variables that are set free
    limits: variable -> (lowest, highest)
    name: name of the condition, or ""
    """
    rows = [Row(NAME, name)] if name else []
    rows += [Row(each, value, model.unit(each)) for each, value in held.items()]
    texts = {FREE: " ".join(free), LIMIT: typed_limits(model, limits)}
    rows += [Row(each, text) for each, text in texts.items() if text]
    return Sheet.of([("", rows, ())])


def matrix(asked: Sequence[Sheet], sheets: Sequence[Sheet]) -> Table:
    """Return the table of trims: what was asked, the column `results`, and what was found.

    A file of conditions may be this table: its columns before `results` state the conditions. A
    value that only some conditions state has a second column, "NAME (trim) [UNIT]".
    """
    conditions, results = matrix_of(asked), matrix_of(sheets)
    headings: dict[int, str] = {}  # place of a column of the results -> its heading
    for place, heading in enumerate(results.header):
        if heading not in conditions.header:
            headings[place] = heading
        elif not _states_each_value(conditions, results, heading):
            name, bracket, unit = heading.partition(" [")
            headings[place] = f"{name} (trim){bracket}{unit}"
    rows = [
        (*condition, result_of(sheet), *(result[place] for place in headings))
        for condition, sheet, result in zip(conditions.rows, sheets, results.rows, strict=True)
    ]
    return Table((*conditions.header, RESULTS, *headings.values()), rows)


def _states_each_value(conditions: Table, results: Table, heading: str) -> bool:
    """Return whether the conditions state each value that the results have in a column."""
    stated = [row[conditions.header.index(heading)] for row in conditions.rows]
    found = [row[results.header.index(heading)] for row in results.rows]
    return all(cell != "" or value == "" for cell, value in zip(stated, found, strict=True))
