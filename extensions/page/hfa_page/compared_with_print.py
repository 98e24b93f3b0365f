"""Tables of A and B with the printed entries below the computed entries."""

from __future__ import annotations

import math

from hfa_model.parameters import INPUTS, LINEAR_STATES
from hfa_model.published import PublishedModel
from hfa_support.reporting.text import TONES, Cell, Table, four_decimals
from trim.hfa.printed import EntryRow, compare
from trim.linear.linear_model import LinearModel

#: Largest deviations, in half units of the last digit, of all tones but the last: same print, one
#: digit off, at most two digits off.
_MOST_HALF_UNITS = (1.0, 2.0, 3.0)


def printed_comparison_tables(model: LinearModel, published: PublishedModel) -> tuple[Table, ...]:
    """Return tables of A and B with a printed row below each computed row.

    The color of an entry depends on its deviation in half units of the last printed digit.
    """
    entries = iter(compare(model, published))
    tables = []
    for name, columns in (("A", LINEAR_STATES), ("B", INPUTS)):
        lines: list[tuple[str, ...]] = []
        for state in LINEAR_STATES:
            row = [next(entries) for _ in columns]
            lines.append((state, *(_toned(entry) for entry in row)))
            lines.append(("printed", *(four_decimals(entry.printed) for entry in row)))
        tables.append(Table((name, *columns), lines))
    return tuple(tables)


def _toned(entry: EntryRow) -> str:
    """Return the table cell of a computed entry, colored by its deviation from the print."""
    shown = four_decimals(entry.computed)
    if entry.is_zero:
        return shown
    tones = zip(TONES, (*_MOST_HALF_UNITS, math.inf), strict=True)
    return Cell(shown, next(tone for tone, most in tones if abs(entry.half_units) <= most))
