"""Numbers as aligned text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

#: Numbers smaller than this are rounding and shown as 0.
ROUNDING = 1e-12


class Table(NamedTuple):
    """A header and its rows: what a CSV file and a terminal table have in common."""

    header: tuple[str, ...]
    rows: Sequence[tuple[Any, ...]]


def matrix_table(name: str, rows: tuple[str, ...], column_names: tuple[str, ...], matrix: Any) -> Table:
    """A matrix with its row and column names, four decimals like the paper's."""
    body = [(row, *(_four_decimals(value) for value in matrix[i].tolist())) for i, row in enumerate(rows)]
    return Table((name, *column_names), body)


def matrix_text(name: str, rows: tuple[str, ...], column_names: tuple[str, ...], matrix: Any) -> str:
    """`matrix_table` as text."""
    return columns(*matrix_table(name, rows, column_names, matrix))


def in_degrees(angle: float) -> float:
    """An angle in degrees as it was asked for: 15, not 14.999999999999998."""
    return round(math.degrees(angle), 10)


def shown_unit(unit: str) -> str:
    """The unit that a person reads: deg in place of rad."""
    return unit.replace("rad", "deg") if unit.startswith("rad") else unit


def short_number(value: float, unit: str) -> str:
    """A value in its `shown_unit` with four digits or more; what is only rounding is 0."""
    shown = math.degrees(value) if unit.startswith("rad") else float(value)
    shown = 0.0 if abs(shown) < ROUNDING else shown
    return f"{shown:.0f}" if 1e4 <= abs(shown) < 1e7 else f"{shown:.4g}"


def eigenvalue_text(value: complex) -> str:
    """An eigenvalue, or a conjugate pair by either of its members: -0.0144 ± 0.7458i."""
    return f"{value.real:.4f}" + (f" ± {abs(value.imag):.4f}i" if value.imag else "")


def _four_decimals(value: float) -> str:
    text = f"{value:.4f}"
    return "0.0000" if text == "-0.0000" else text


def degrees(value: float, unit: str) -> tuple[str, str]:
    """A value and its unit as a person reads them: radians become degrees."""
    if unit.startswith("rad"):
        return f"{math.degrees(value):.5f}", unit.replace("rad", "deg")
    return f"{value:.5f}", unit


def columns(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """Rows of text in aligned columns: the first to the left, the others to the right."""
    table = [header, *rows]
    widths = [max(len(row[i]) for row in table) for i in range(len(header))]
    lines = [
        "  ".join(
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in table
    ]
    return "\n".join(line.rstrip() for line in lines)
