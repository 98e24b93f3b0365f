"""Loading of operating points from files, and their report without a search."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_support.errors import BadInputError, shortened
from hfa_support.files import read_json
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, degrees
from hfa_support.schema import NUMBER, checked
from hfa_support.units import conversion, si_unit
from trim.point.operating_point import SCHEMA, OperatingPoint
from trim.point.status import Status

#: Entries of a saved point; files of later versions may contain more.
_FILE: dict[Any, Any] = {
    "schema*": (SCHEMA,),
    "dynamics*": str,
    "status*": tuple(Status),
    "states*": {str: NUMBER},
    "state_units": {str: str},
    "inputs*": {str: NUMBER},
    "residuals*": {str: NUMBER},
    ...: None,
}


def loaded_point(path: Path, model: Model) -> OperatingPoint:
    """Return an operating point of a model from a file.

    path: file of the point, of a trim, or of a linear model
    model: model of the point

    Raises BadInputError, which names the file and the fault, if the file contains no point of the
    model.
    """
    try:
        data = read_json(path)
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read ({error.strerror}); give a readable operating point"
        ) from error
    if isinstance(data, dict):
        data = data.get("operating_point", data)
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        raise BadInputError(
            f"{path} is not an operating point of schema {SCHEMA}; save the operating point again"
        )
    names = {
        kind: {f"{name}*": NUMBER for name in getattr(model, kind)} for kind in ("states", "inputs")
    }
    found = checked(
        str(path), data, {**_FILE, "states*": names["states"], "inputs*": names["inputs"]}
    )
    stated = found.get("state_units", {})
    values = found["states"]
    for name in model.states:
        unit = model.unit(name)
        factor = conversion(stated.get(name, unit), unit)
        if factor is None:
            known = dict.fromkeys((unit, si_unit(unit)))
            raise BadInputError(
                f"{path}: {name} is in {shortened(stated[name])}; use {' or '.join(known)}"
            )
        values[name] = values[name] * factor
    states, inputs = (
        record(tuple(getattr(model, kind)))(**found[kind]) for kind in ("states", "inputs")
    )
    return OperatingPoint(states, inputs, found["residuals"], Status(found["status"]), model)


def point_records(point: OperatingPoint) -> Table:
    """Return a table of the states, inputs and residuals of an operating point.

    Each row is (kind, name, value, unit). The unit of an angle is rad.
    """
    unit = point.model.unit
    rows: list[tuple[str, str, float, str]] = []
    for kind, values in (("state", point.states), ("input", point.inputs)):
        rows += [(kind, name, value, unit(name)) for name, value in values._asdict().items()]
    for name, value in point.residuals.items():
        rows.append(("residual", name, value, point.equation_unit(name)))
    return Table(("kind", "name", "value", "unit"), rows)


def saved_report(point: OperatingPoint) -> Report:
    """Return a report of the states and inputs of a point that was not found by a search."""
    records = point_records(point)
    rows = [
        (kind, name, *degrees(value, unit))
        for kind, name, value, unit in records.rows
        if kind != "residual"
    ]
    table = Table(records.header, rows)
    return Report(point.title, [table], point.warnings, point.as_data(), records)
