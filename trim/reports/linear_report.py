"""Report of a linear model: matrices, offsets, modes and handling qualities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Entries
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import WIDTH, Table, five_decimals, matrix_table, wrapped
from trim.linear.linear_model import LinearModel
from trim.linear.modes import modes_table
from trim.reports.first_lines import first_lines, mode_lines, without_line_numbers
from trim.reports.levels import handling_qualities
from trim.reports.trimmed import Trimmed


class Block(NamedTuple):
    """Matrix A to F in a report, with the names of its rows and columns.

    name: name of the matrix
    rows, columns: names of the signals
    values: (rows, columns)
    """

    name: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    values: np.ndarray


class Beside(NamedTuple):
    """What the report of a linear model shows beside the model: comparisons with other sources.

    accuracy: sentences on the accuracy of the entries
    others: figures of other models at the same condition
    printed: tables of the entries beside those printed in the paper
    data: entries by name
    """

    accuracy: str
    others: Sequence[Group]
    printed: Sequence[Table]
    data: Mapping[str, Any]


def report_of_linear(
    model: LinearModel, *, responses: bool, beside: Beside | None, whole: bool = False
) -> Report:
    """Return a report of a linear model: A, B, the offsets, the modes and the handling qualities.

    C and D are included if the outputs are not the states. The data of the report also contain E
    and F.

    whole: whether to include E of the disturbances, and F beside D
    responses: whether to add the frequency responses at the natural frequencies of the modes
    beside: accuracy of the entries, and what other models and the paper give for them, or None
    """
    aircraft = model.model
    trimmed = Trimmed(model.point)
    blocks = _blocks(model, whole=whole)
    parts: list[Part] = [_matrix(block) for block in blocks]
    data: dict[str, Any] = {}  # in addition to that of the model
    if beside is not None:
        parts.append(beside.accuracy)
        data |= beside.data
    parts += [_offsets_table(model), modes_table(model.modes, aircraft.time_unit)]
    if beside is not None:
        parts += beside.others
    qualities = tuple(handling_qualities(trimmed))
    if qualities:
        title = "handling qualities"
        if len(model.states) < len(aircraft.linear):  # they are computed from all linear states
            title += f", all {len(aircraft.linear)} states"
        parts.append(Group(title, qualities))
        data["handling_qualities"] = {row.name: row for row in qualities}
    if responses:
        from trim.linear.frequency import responses_at_modes, responses_table

        at_modes = responses_at_modes(model)
        parts.append(responses_table(at_modes, aircraft.time_unit))
        data |= {"frequencies": at_modes.frequencies, "responses": at_modes.by_channel}
    if beside is not None:
        parts += beside.printed
    records = _records(model, blocks)
    notes = without_line_numbers(model.warnings)
    title = _first_lines(model, trimmed, blocks)
    return Report(title, parts, notes, Entries(model, data), records)


def _first_lines(model: LinearModel, trimmed: Trimmed, blocks: Sequence[Block]) -> str:
    """Return the title: condition, modes, equations, and units of the matrices."""
    names = [block.name for block in blocks]
    to_winds = {"E": " + E w", "F": " + F w"}
    of_rates, of_outputs = (to_winds[name] if name in names else "" for name in to_winds)
    equations = f"x' = A x + B u{of_rates}, "
    if "C" in names:
        equations += f"y = C x + D u{of_outputs}, "
    units = f"{', '.join(names[:-1])} and {names[-1]} in the units of the offsets, angles in rad"
    lines = [
        first_lines(trimmed, model.modes),
        mode_lines(model.modes, model.model),
        f"{equations}x = X - X0, u = U - U0",
        wrapped(units, WIDTH),
    ]
    return "\n".join(lines)


def _offsets_table(model: LinearModel) -> Table:
    """Return a table of the offsets X0 and U0, and Y0 of outputs, with angles in degrees."""
    outputs = () if model.outputs == model.states else model.outputs
    offsets = (
        *zip(model.states, model.state_offsets.tolist(), strict=True),
        *zip(model.inputs, model.input_offsets.tolist(), strict=True),
        *zip(outputs, model.output_offsets.tolist(), strict=False),
    )
    rows = [(name, *five_decimals(value, model.model.unit(name))) for name, value in offsets]
    return Table(("offset", "value", "unit"), rows)


def _records(model: LinearModel, blocks: list[Block]) -> Table:
    """Return a table in full precision of the entries and offsets of a linear model: (matrix, "X0"
    or "U0", row name, column name, value, unit).
    """
    unit_of, rate_unit = model.model.unit, model.model.rate_unit
    rows: list[tuple[Any, ...]] = []
    for block in blocks:
        unit_of_row = rate_unit if block.name in "ABE" else unit_of
        for i, row in enumerate(block.rows):
            for j, column in enumerate(block.columns):
                unit = f"({unit_of_row(row)})/({unit_of(column)})"
                rows.append((block.name, row, column, block.values[i, j], unit))
    for offset, names in (("X0", model.states), ("U0", model.inputs)):
        rows += [(offset, name, "", model.point.values[name], unit_of(name)) for name in names]
    return Table(("matrix", "row", "column", "value", "unit"), rows)


def matrices(model: LinearModel) -> list[Table]:
    """Return tables of the matrices A and B, and of C and D if the outputs are not the states."""
    return [_matrix(block) for block in _blocks(model, whole=False)]


def _matrix(block: Block) -> Table:
    return matrix_table(block.name, block.rows, block.columns, block.values)


def reported_matrices(signals: Any) -> str:
    """Return the names of the matrices that are neither empty nor the identity and 0.

    signals: object with names of the `states`, `outputs` and `disturbances` of linear models
    """
    of_outputs = signals.outputs != signals.states
    winds = ("EF" if of_outputs else "E") if signals.disturbances else ""
    return f"AB{'CD' if of_outputs else ''}{winds}"


def _blocks(model: LinearModel, *, whole: bool) -> list[Block]:
    """Return the `reported_matrices`, E and F only with `whole`."""
    columns = {"A": model.states, "B": model.inputs, "E": model.disturbances}
    columns |= dict(zip("CDF", columns.values(), strict=True))
    return [
        Block(
            name,
            model.states if name in "ABE" else model.outputs,
            columns[name],
            getattr(model, name),
        )
        for name in reported_matrices(model)
        if whole or name not in "EF"
    ]
