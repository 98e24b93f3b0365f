"""Rows of cells of a text file, as spreadsheets and programs write it."""

from __future__ import annotations

import csv
import re

from hfa_support.errors import BadInputError

#: Byte order mark -> encoding. Without one, a text is in UTF-8, or else as Windows writes it.
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"": "utf-8-sig"}
#: Number with a decimal comma, or a point, and a unit or none.
_DECIMAL_COMMA = re.compile(r"([-+]?\d*),(\d+(?:[eE][-+]?\d+)?\s*[^\d,.]*)")
_DECIMAL_POINT = re.compile(r"[-+]?\d*\.\d+(?:[eE][-+]?\d+)?\s*[^\d,.]*")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+\D*")


def rows_of_text(where: str, content: bytes) -> list[tuple[int, list[str]]]:
    """Return the rows of a text, each with its number and its cells without outer blanks.

    Cells are separated by commas, tabs or semicolons, as in the first row. Decimal commas become
    points. Empty rows, and comments, which begin with #, are left out.

    where: the file, for messages

    Raises BadInputError for a text that has no rows or is no such table.
    """
    encoding = next(of for mark, of in _MARKS.items() if content.startswith(mark))
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    lines = ["" if line.lstrip().startswith("#") else line for line in text.splitlines()]
    first = next(filter(str.strip, lines), "")
    separator = next((mark for mark in "\t;" if mark in first), ",")
    try:
        rows = [
            (number, [cell.strip() for cell in row])
            for number, row in enumerate(csv.reader(lines, delimiter=separator), start=1)
            if any(cell.strip() for cell in row)
        ]
    except csv.Error as error:
        raise BadInputError(f"{where} cannot be read as CSV ({error}); correct the file") from error
    if not rows:
        raise BadInputError(f"{where} is empty; give a row of names, then rows of values")
    return _with_decimal_points(where, rows, separator)


def _with_decimal_points(
    where: str, rows: list[tuple[int, list[str]]], separator: str
) -> list[tuple[int, list[str]]]:
    """Return rows with points in place of decimal commas, and without commas between thousands.

    Between semicolons, commas are decimal. Between commas, those of 20,000 separate thousands if
    no cell has another comma.
    """
    cells = {cell for _, row in rows for cell in row}
    in_thousands = {*filter(_THOUSANDS.fullmatch, cells)} if separator != ";" else set()
    with_comma = {*filter(_DECIMAL_COMMA.fullmatch, cells)} | in_thousands
    if not with_comma:
        return rows
    point = "" if separator == "," and with_comma == in_thousands else "."
    if point and (in_thousands or any(map(_DECIMAL_POINT.fullmatch, cells))):
        doubtful = min(in_thousands or with_comma)
        raise BadInputError(
            f"{where} contains decimal commas and points, or {doubtful}, whose comma may separate "
            "thousands; give decimal points alone"
        )
    return [
        (number, [cell.replace(",", point) if cell in with_comma else cell for cell in row])
        for number, row in rows
    ]
