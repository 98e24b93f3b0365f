"""Operating points as rows of a table."""

from __future__ import annotations

from hfa_support.reporting.text import Table
from trim.point.operating_point import OperatingPoint


def point_records(point: OperatingPoint) -> Table:
    """Return a table of the states, inputs and residuals of an operating point.

    Each row is (kind, name, value, unit). The unit of an angle is rad.
    """
    unit = point.model.unit
    rows: list[tuple[str, str, float, str]] = []
    for kind, record in (("state", point.states), ("input", point.inputs)):
        rows += [(kind, name, value, unit(name)) for name, value in record._asdict().items()]
    for name, value in point.residuals.items():
        rows.append(("residual", name, value, point.equation_unit(name)))
    return Table(("kind", "name", "value", "unit"), rows)
