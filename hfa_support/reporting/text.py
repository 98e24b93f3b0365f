"""Formatting of numbers and tables as aligned text. Numbers of reports are formatted only here."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from decimal import ROUND_CEILING, ROUND_HALF_EVEN, Decimal
from typing import Any, NamedTuple, Self

import numpy as np

from hfa_support.errors import printable

#: Smaller numbers, as a fraction of their nominal size, are rounding errors and are shown as 0: a
#: computed 0 is the sum of terms up to 1e4 times that size, with roundings of 1e4 eps = 2e-12.
SHOWN_AS_ZERO = 1e-12
#: Range of the largest magnitude in a matrix that is shown with four decimals.
_LEAST_AS_DECIMALS = 0.1
_MOST_AS_DECIMALS = 1e7
#: Tone, from the best to the worst -> color code of a terminal.
TONES = {"good": "32", "near": "33", "far": "35", "bad": "31"}
#: Largest number of characters in a line of a report.
WIDTH = 80
#: Gap between two columns.
_GAP = "  "


class Table(NamedTuple):
    """Header and rows of a table, for a terminal or a CSV file.

    header: names of the columns
    rows: one tuple of cells or values for each row
    labels: number of first columns that name a row; each block of a wide table repeats them
    """

    header: tuple[str, ...]
    rows: Sequence[tuple[Any, ...]]
    labels: int = 1


class Cell(str):
    """Text of a table cell, with a tone that colors it and a link.

    tone: a key of `TONES`, or "" for no color
    link: `anchor` of the report that the cell links to in documents, or ""
    """

    tone: str
    link: str

    def __new__(cls, text: str, tone: str = "", link: str = "") -> Self:
        """Return a cell with this text, tone and link."""
        cell = super().__new__(cls, text)
        cell.tone = tone
        cell.link = link
        return cell


def matrix_table(
    name: str,
    rows: tuple[str, ...],
    column_names: tuple[str, ...],
    matrix: Any,
    digits: int | None = None,
) -> Table:
    """Return a table of a matrix, with the names of its rows and columns and four decimals.

    An entry that rounds to 0 is printed with an exponent, unless it is `SHOWN_AS_ZERO`. All entries
    are printed with an exponent if the largest magnitude is nonzero and below 0.1, or at least 1e7.

    name: text above the row names
    rows: names of the rows
    column_names: names of the columns
    matrix: (rows, columns)
    digits: number of significant digits of all entries; None for four decimals
    """
    largest = float(np.abs(matrix).max(initial=0.0))
    form: Callable[[float], str]
    if digits is not None:
        form = f"{{:.{digits - 1}e}}".format
    elif _LEAST_AS_DECIMALS <= largest < _MOST_AS_DECIMALS or largest == 0.0:
        form = _entry_text
    else:
        form = "{:.4e}".format
    body = [(row, *map(form, matrix[i].tolist())) for i, row in enumerate(rows)]
    return Table((name, *column_names), body)


def entry_rows(
    P: tuple[np.ndarray, ...], K: tuple[np.ndarray, ...], names: Any
) -> list[tuple[Any, ...]]:
    """Return table rows that compare several P and several K entry by entry, P before K.

    A row is ("P" or "K", row name, column name, the entry of each matrix, unit).

    P: matrices (n, n) to compare
    K: matrices (m, n) to compare
    names: object with `states`, `inputs`, `state_units` and `input_units`, where an unknown unit is
      ""
    """
    kinds = (
        ("P", P, names.states, names.state_units, "1/(({}) ({}))"),  # z'Pz has no unit
        ("K", K, names.inputs, names.input_units, "({})/({})"),
    )
    rows: list[tuple[Any, ...]] = []
    for name, matrices, row_names, row_units, unit_text in kinds:
        if not matrices:
            continue
        for i, row in enumerate(row_names):
            for j, column in enumerate(names.states):
                entries = [matrix[i, j] for matrix in matrices]
                column_unit = names.state_units[j]
                unit = unit_text.format(row_units[i], column_unit) if column_unit else ""
                rows.append((name, row, column, *entries, unit))
    return rows


def numbered(letter: str, count: int) -> tuple[str, ...]:
    """Return `count` names that consist of a letter and a number: "x1", "x2", ..."""
    return tuple(f"{letter}{i + 1}" for i in range(count))


def in_degrees(angle: float) -> float:
    """Return an angle in degrees, rounded to ten decimals: 15 in place of 14.999999999999998.

    angle: rad
    """
    return round(math.degrees(angle), 10)


def without_rounding(value: float, nominal: float = 1.0) -> float:
    """Return a number, or 0 in place of rounding.

    nominal: nominal size of such numbers
    """
    return 0.0 if abs(value) < SHOWN_AS_ZERO * nominal else value


def shown_unit(unit: str) -> str:
    """Return the unit in which reports print values with a unit: deg for rad, deg/s for rad/s, and
    other units unchanged.
    """
    return unit.replace("rad", "deg") if unit.startswith("rad") else unit


def beside_unit(text: str, unit: str, between: str = " ") -> str:
    """Return a text followed by the unit that reports print, "5 deg", or the text alone if the unit
    is 1.
    """
    return text if unit in ("", "1") else f"{text}{between}{shown_unit(unit)}"


def with_shown_unit(name: str, unit: str) -> str:
    """Return the heading of a column of numbers in the unit that reports print: "alpha [deg]"."""
    return name if unit in ("", "1") else f"{name} [{shown_unit(unit)}]"


def shown_values(values: Any, unit: str) -> Any:
    """Return a number or an array in the unit that reports print (`shown_unit`)."""
    return np.degrees(values) if unit.startswith("rad") else values


def shown_value(value: float, unit: str, form: str = ".6g") -> str:
    """Return a value as text, in the unit that reports print (`shown_unit`).

    form: format specification of the number
    """
    return format(float(shown_values(value, unit)), form)


def with_unit(value: float, unit: str, nominal: float = 1.0) -> str:
    """Return a value with its unit as text, "5 deg", in the unit that reports print.

    An angle in radians above a full turn may have been meant in degrees. Such an angle is therefore
    also printed in radians: "859.437 deg (15 rad)".

    nominal: nominal size of the value; of a value far below it, 0 is printed
    """
    value = without_rounding(value, nominal)
    text = beside_unit(shown_value(value, unit), unit)
    is_large = unit == "rad" and abs(value) > 2.0 * math.pi
    return f"{text} ({value:g} rad)" if is_large else text


def five_decimals(value: float, unit: str) -> tuple[str, str]:
    """Return a value as text with five decimals, and its unit, in the unit that reports print.

    A large value is printed with an exponent, for example as 1e+08.
    """
    return shown_value(value, unit, "z.5f" if abs(value) < 1e8 else ".6g"), shown_unit(unit)


def short_number(value: float, unit: str, count: int = 4) -> str:
    """Return a value as text with `count` significant digits, in the unit that reports print.

    A magnitude of more digits, below 1e7, is rounded to a whole number, and has no exponent.
    """
    shown = without_rounding(float(shown_values(value, unit)))
    return f"{shown:.0f}" if 10.0**count <= abs(shown) < 1e7 else f"{shown:.{count}g}"


def digits(value: float, count: int = 3) -> str:
    """Return a number as text with `count` significant digits. A number from 1000 on that has more
    digits before the point is rounded to a whole number: "40,000".
    """
    return f"{value:,.0f}" if abs(value) >= 10 ** max(count, 3) else f"{value:z,.{count}g}"


def percent(value: float, count: int = 2, *, up: bool = False) -> str:
    """Return a percentage as text with `count` significant digits, and whole from 100 to a million.

    value: the percentage
    up: whether it is an upper bound, which is rounded up

    >>> percent(634.2), percent(31.23, up=True), percent(0.0000753)
    ('634 %', '32 %', '7.5e-05 %')
    """
    if not math.isfinite(value) or value == 0.0:
        return f"{abs(value):g} %"
    exact = Decimal(value)  # an upper bound must not be rounded down in doubles
    is_whole = 100.0 <= abs(value) < 1e6
    last_digit = Decimal(1).scaleb(0 if is_whole else exact.adjusted() - count + 1)
    rounded = float(exact.quantize(last_digit, ROUND_CEILING if up else ROUND_HALF_EVEN))
    is_whole = 10.0**count <= abs(rounded) < 1e6  # rounding may add a digit: 99.6 becomes 100
    return f"{rounded:.0f} %" if is_whole else f"{rounded:.{count}g} %"


def digits_with_unit(value: float, unit: str, count: int = 3, nominal: float = 1.0) -> str:
    """Return a value with `count` significant digits and its unit, "40,000 ft", in the unit that
    reports print.

    nominal: nominal size of the value; of a value far below it, 0 is printed
    """
    value = without_rounding(value, nominal)
    return beside_unit(digits(float(shown_value(value, unit, ".12g")), count), unit)


def eigenvalue_text(value: complex) -> str:
    """Return the text of a real eigenvalue or a conjugate pair, for example "-0.0144 ± 0.7458i".

    A part that four decimals do not show has an exponent. A part of `value` that is rounding must
    be 0 already.

    value: the eigenvalue, or either member of the pair
    """
    real, imaginary = map(_entry_text, (value.real, abs(value.imag)))
    return real + (f" ± {imaginary}i" if value.imag else "")


def _entry_text(value: float) -> str:
    """Return an entry of a matrix with four decimals, or with an exponent if it is not 0 and its
    four decimals are.
    """
    text = four_decimals(value)
    return f"{value:.1e}" if text == "0.0000" and without_rounding(value) else text


def four_decimals(value: float) -> str:
    """Return a number as text with four decimals. Zero has no sign."""
    return f"{value:z.4f}"


def columns(
    header: tuple[str, ...],
    rows: Sequence[tuple[Any, ...]],
    labels: int = 1,
    color: bool = False,
    width: int | None = None,
) -> str:
    """Return a table as text in columns, the first aligned left and all others aligned right.

    labels: number of first columns that name a row
    color: whether cells with a tone are colored
    width: width of the terminal in characters, or None. Columns that do not fit are printed in
      further blocks, each of which repeats the labels. Cells are never broken.
    """
    cells = (header, *rows)
    texts = [[printable(cell) for cell in row] for row in cells]
    widths = [max(len(row[i]) for row in texts) for i in range(len(header))]
    blocks = []
    for block in blocks_that_fit(widths, labels, width, len(_GAP)):
        lines = []
        for row, row_cells in zip(texts, cells, strict=True):
            aligned = []
            for i in block:
                text = row[i].rjust(widths[i]) if i else row[i].ljust(widths[i])
                tone = TONES.get(getattr(row_cells[i], "tone", ""))
                aligned.append(f"\033[{tone}m{text}\033[0m" if color and tone else text)
            lines.append(_GAP.join(aligned).rstrip())
        blocks.append("\n".join(lines))
    return "\n\n".join(blocks)


def blocks_that_fit(
    widths: Sequence[float], labels: int, room: float | None, gap: float = 0.0
) -> list[list[int]]:
    """Return the indices of the columns in each block of a table.

    Each block contains the labels and as many other columns as fit, at least one.

    labels: number of first columns that name a row
    room: width of a block, or None for a single block
    gap: width between two columns
    """
    blocks = [[*range(min(labels, len(widths)))]]
    for i in range(labels, len(widths)):
        needed = sum(widths[column] + gap for column in (*blocks[-1], i)) - gap
        if room is not None and needed > room and len(blocks[-1]) > labels:
            blocks.append([*range(labels)])
        blocks[-1].append(i)
    return blocks


def are_words(cells: Sequence[Any]) -> bool:
    """Return whether a table column consists of words rather than numbers.

    It does if fewer than half of the nonempty cells begin with a digit, sign, point or ∞.
    """
    texts = [text for cell in cells if (text := str(cell)) not in ("", "-")]
    numbers = [text for text in texts if text[0].isdigit() or text[0] in "+-.±∞"]
    return 2 * len(numbers) < len(texts)


def is_warning(line: str) -> bool:
    """Return whether a first line is a stall or a warning, which documents show in bold."""
    return line.startswith(("STALLED", "Check:"))


def flowing(text: str) -> str:
    """Return a text in which lines that end with a comma or semicolon are joined with the next."""
    return re.sub(r"(?<=[,;])\n", " ", text)


def wrapped(text: str, width: int | None) -> str:
    """Return a text with its lines wrapped between words.

    width: largest number of characters in a line, or None to return the text unchanged
    """
    if width is None:
        return text
    import textwrap

    return "\n".join(
        textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False)
        for line in text.split("\n")
    )
