"""Reports of lower bounds of the cost: text, tables and data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hfa_prove.check import Proved
from hfa_prove.results import CheckedLowerBound, FoundLowerBound
from hfa_prove.statements.cost import CostStatement
from hfa_prove.subject import qualified
from hfa_prove.words import at_least, limits_in_words, parameters_in_words, piece_in_words
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    from hfa_prove.search.cost import CostBound


def found_bound_report(found: CostBound) -> Report:
    """Return the report of a proved lower bound of the cost.

    For each piece, the report lists the share of the default initial conditions at which W is below
    its level, and the median of W relative to the linear quadratic cost there.
    """
    statement = found.statement
    rows = []
    for i, piece in enumerate(statement.pieces):
        fit, proof = found.seconds[i]
        ratio = f"{found.over_linear[i]:.2f}" if found.covered[i] else "-"
        times = (f"{fit:.1f} s", f"{proof:.1f} s")
        level = at_least(piece.c, 6)
        rows.append((level, f"{found.covered[i]:.1%}", ratio, str(found.boxes[i]), *times))
    header = ("level", "share of the box", "W / linear cost", "boxes", "fit", "proof")
    lines = [_sentence(statement)]
    lines.append("Share of the box: default initial conditions at which W is below the level.")
    if found.stopped:
        lines.append(f"Further pieces: {found.stopped}.")
    data = FoundLowerBound(statement, found.boxes, found.covered, found.stopped).as_data()
    parts: tuple[str | Table, ...] = (*lines, Table(header, rows), limits_of(statement))
    return Report(_title(statement, "Proved"), parts, data=data)


def checked_bound_report(verified: Proved, not_given: Sequence[str]) -> Report:
    """Return the report of a checked certificate of a lower bound of the cost.

    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    pairs = zip(statement.pieces, verified.sizes, strict=True)
    rows = [(at_least(piece.c, 6), str(boxes)) for piece, boxes in pairs]
    checked = CheckedLowerBound(statement, verified.sizes, verified.written, list(not_given))
    title = _title(statement, "Verified, proved", not_given)
    plant = statement.plant
    parts: tuple[str | Table, ...] = (
        _sentence(statement),
        Table(("level", "boxes"), rows),
        limits_of(statement),
        *_weights(statement),
        parameters_in_words(plant.model, plant.parameters),
    )
    pieces: list[str | Table] = []
    for piece in statement.pieces:
        pieces += piece_in_words(piece, plant.states)
    return Report(title, (*parts, *pieces), data=checked.as_data())


def _title(statement: CostStatement, verdict: str, not_given: Sequence[str] = ()) -> str:
    """Return the first line of a report.

    The line states the claim, the parts of the statement that were not compared, and the effects
    that the proof neglects.

    verdict: first words of the line
    not_given: parts of the statement that were not compared
    """
    claim = f"{verdict}: lower bound of the cost of flights of {statement.plant.model.title}"
    return f"{qualified(claim, not_given)}, without disturbances"


def _sentence(statement: CostStatement) -> str:
    held = statement.plant.held
    kept = f" {', '.join(held)} held at trim values." if held else ""
    return (
        "No flight within the limits that ends at the trim costs less than the smaller of the "
        "level and W at its initial condition. Cost: the integral of x'Qx + u'Ru, in deviations "
        f"from the trim.{kept}"
    )


def limits_of(statement: CostStatement) -> Table:
    """Return a table of trim, equilibrium and limits of each state and input."""
    plant = statement.plant
    rows = []
    for name, value in {**plant.trim, **plant.inputs, **plant.held}.items():
        at = statement.equilibrium.get(name, value)
        values = [plant.model.describe(name, each) for each in (value, at)]
        rows.append((name, *values, *limits_in_words(plant, name)))
    return Table(("flights within", "trim", "equilibrium", "lowest", "highest"), rows)


def _weights(statement: CostStatement) -> tuple[str, ...]:
    parts = []
    for name in ("Q", "R"):
        matrix = getattr(statement, name)
        if np.array_equal(matrix, np.diag(np.diag(matrix))):
            diagonal = ", ".join(f"{value:.6g}" for value in np.diag(matrix))
            parts.append(f"{name}: diagonal {diagonal}.")
        else:
            rows = "; ".join(", ".join(f"{value:.6g}" for value in row) for row in matrix)
            parts.append(f"{name}: {rows}.")
    return tuple(parts)
