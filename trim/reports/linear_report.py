"""Report of a linear model: matrices, offsets, modes and handling qualities."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import storable
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import WIDTH, Table, degrees, matrix_table, wrapped
from trim.linear.frequency import responses_at_modes, responses_table
from trim.linear.linear_model import LinearModel
from trim.linear.modes import modes_table
from trim.reports.first_lines import first_line, mode_lines, without_lines
from trim.reports.handling_qualities import handling_qualities
from trim.reports.trimmed import Trimmed

#: Units of length.
_LENGTHS = ("ft", "m", "km", "nmi", "mi", "in", "cm", "mm")


class Block(NamedTuple):
    """Matrix A, B, C or D in a report, with the names and units of its rows and columns.

    name: name of the matrix
    rows, columns: names of the signals
    row_units, column_units: units of the signals, or of the rates of states
    values: (rows, columns)
    """

    name: str
    rows: tuple[str, ...]
    row_units: tuple[str, ...]
    columns: tuple[str, ...]
    column_units: tuple[str, ...]
    values: np.ndarray


class Beside(NamedTuple):
    """What is known of a linear model from elsewhere, for its report.

    accuracy: sentences on the accuracy of the entries
    others: figures of other models at the same condition
    printed: tables of entries that were published
    bands: matrix -> half-widths of the error bands of its entries
    data: entries by name
    """

    accuracy: str
    others: Sequence[Group]
    printed: Sequence[Table]
    bands: Mapping[str, np.ndarray]
    data: Mapping[str, Any]


def report_of_linear(
    model: LinearModel, *, responses: bool = False, beside: Beside | None = None
) -> Report:
    """Return a report of a linear model: A, B, the offsets, the modes and the handling qualities.

    C and D are included if the outputs are not the states. The data of the report also contain E
    and F.

    responses: whether to add the frequency responses at the natural frequencies of the modes
    beside: what is known from elsewhere
    """
    point = model.point
    signals = point.model
    trimmed = Trimmed(point)
    modes = model.modes
    blocks = _blocks(model)
    matrix_names = [block.name for block in blocks]
    equations = "x' = A x + B u, "
    if "C" in matrix_names:
        equations += "y = C x + D u, "
    title = "\n".join(
        [
            first_line(trimmed, "linearized", modes),
            mode_lines(modes, signals),
            f"{equations}x = X - X0, u = U - U0",
            wrapped(
                f"{', '.join(matrix_names[:-1])} and {matrix_names[-1]} in {units_in_words(model)};"
                " X0 and U0 in the units of their table",
                WIDTH,
            ),
        ]
    )
    parts: list[Part] = [_matrix(block) for block in blocks]
    data = storable(model)
    if beside is not None:
        parts.append(beside.accuracy)
        data |= beside.data
    names = (*model.states, *model.inputs)
    offsets = (*model.state_offsets.tolist(), *model.input_offsets.tolist())
    offset_rows = [
        (name, *degrees(value, signals.unit(name)))
        for name, value in zip(names, offsets, strict=True)
    ]
    parts.append(Table(("offset", "value", "unit"), offset_rows))
    parts.append(modes_table(modes, signals.time_unit))
    if beside is not None:
        parts += beside.others
    qualities = tuple(handling_qualities(trimmed))
    if qualities:
        of_all = f", all {len(signals.linear)} states" * (len(model.states) < len(signals.linear))
        parts.append(Group(f"handling qualities{of_all}", qualities))
        data["handling_qualities"] = {row.name: row for row in qualities}
    if responses:
        at_modes = responses_at_modes(model)
        parts.append(responses_table(at_modes, signals.time_unit))
        data |= {"frequencies": at_modes.frequencies, "responses": at_modes.by_channel}
    if beside is not None:
        parts += beside.printed
    records = _records(model, blocks, None if beside is None else beside.bands)
    return Report(title, parts, without_lines(model.warnings), data, records)


def _records(
    model: LinearModel, blocks: list[Block], bands: Mapping[str, np.ndarray] | None
) -> Table:
    """Return a table in full precision of the entries and offsets of a linear model.

    bands: as in `Beside`, for a column of their own; None without this column
    """
    # Each row is (matrix, row name, column name, value, unit, band). An offset has "X0" or "U0" in
    # place of a matrix.
    rows: list[tuple[Any, ...]] = []
    for block in blocks:
        of_block = (bands or {}).get(block.name)
        for i, row in enumerate(block.rows):
            for j, column in enumerate(block.columns):
                unit = f"({block.row_units[i]})/({block.column_units[j]})"
                band = "" if of_block is None else of_block[i, j]
                rows.append((block.name, row, column, block.values[i, j], unit, band))
    unit_of = model.model.unit
    for offset, names in (("X0", model.states), ("U0", model.inputs)):
        for name in names:
            rows.append((offset, name, "", model.point.values[name], unit_of(name), ""))
    header = ("matrix", "row", "column", "value", "unit", "band")
    width = len(header) - (bands is None)
    return Table(header[:width], [row[:width] for row in rows])


def units_in_words(model: LinearModel) -> str:
    """Return the units of a linear model's matrices as text, such as "rad, ft, s, but elevator in
    deg".

    Signals in units other than the common ones are listed after "but".
    """
    units = model.model.units
    length = next(
        (unit for state in model.state_units for unit in _base_units(state) if unit in _LENGTHS), ""
    )
    names = dict.fromkeys((*model.states, *model.inputs, *model.outputs))
    time = model.model.time_unit
    common = {"rad", length, time}
    others: dict[str, list[str]] = {}
    present = {time}
    for name, unit in zip(names, units(tuple(names)), strict=True):
        bases = _base_units(unit)
        if bases <= common:
            present |= bases
        else:
            others.setdefault(unit, []).append(name)
    words = ", ".join(unit for unit in ("rad", length, time) if unit in present)
    if others:
        listed = [f"{', '.join(names)} in {unit}" for unit, names in others.items()]
        words += f", but {'; '.join(listed)}"
    return words


def _base_units(unit: str) -> set[str]:
    """Return the base units in a unit: ft and s for ft/s^2."""
    return {*re.findall(r"[A-Za-z%]+", unit)}


def matrices(model: LinearModel) -> list[Table]:
    """Return tables of the matrices A and B, and of C and D if the outputs are not the states."""
    return [_matrix(block) for block in _blocks(model)]


def _matrix(block: Block) -> Table:
    return matrix_table(block.name, block.rows, block.columns, block.values)


def _blocks(model: LinearModel) -> list[Block]:
    """Return the reported matrices: A and B, and C and D if the outputs are not the states."""
    signals = model.model
    of_states = (model.states, model.state_units)
    of_inputs = (model.inputs, model.input_units)
    rates = (model.states, tuple(signals.rate_unit(name) for name in model.states))
    blocks = [Block("A", *rates, *of_states, model.A), Block("B", *rates, *of_inputs, model.B)]
    if model.outputs != model.states:
        outputs = (model.outputs, signals.units(model.outputs))
        blocks.append(Block("C", *outputs, *of_states, model.C))
        blocks.append(Block("D", *outputs, *of_inputs, model.D))
    return blocks
