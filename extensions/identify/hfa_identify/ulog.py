"""Reader of PX4 logs (.ulg), with pyulog and a table that defines the columns.

The table defines each column by a message and field of the log, and a conversion:

    [columns]
    pitch_rate = "vehicle_angular_velocity.xyz[1]"
    pitch = "vehicle_attitude.pitch"
    elevator = { field = "actuator_servos.control[1]", scale = 0.35, offset = -0.02 }
    thrust = { field = "actuator_motors.control[0]", scale = 40.0, instance = 0 }

    [flight]
    begin = 100.0
    end = 130.0

A column is offset + scale field, in the unit of the model. The fields `roll`, `pitch` and `yaw`,
rad, are computed for a message with a quaternion q[0] to q[3]. [flight] selects a part of the log,
in seconds after its start.

Source of the format: PX4 user guide, "ULog file format".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError, is_finite, missing_package, refuse_unknown, shown
from hfa_support.files import read_toml

_ADVICE = 'write alpha = "message.field", or { field = "message.field", scale = 1.0 }'
#: Optional keys of a column -> default value.
_NUMBERS = {"scale": 1.0, "offset": 0.0, "instance": 0}
#: Length of a microsecond, s.
_MICRO = 1e-6


@dataclass(frozen=True)
class LoggedColumn:
    """Definition of a column as offset + scale field, for a field of a log.

    name: name of the column
    message: name of the message
    field: name of the field in the message
    scale: factor on the field
    offset: value added to the scaled field
    instance: number of the message's instance
    """

    name: str
    message: str
    field: str
    scale: float
    offset: float
    instance: int


def ulog_columns(path: Path, table: Path | None, model: Model) -> dict[str, np.ndarray]:
    """Return the columns (N,) of a log, by name, as defined by a table.

    The column "time" contains the time after its first sample, s. The times are those of the
    measured quantity with the most samples. Samples of other measured quantities are assigned to
    the nearest of these times. Between samples, an input keeps its last value.

    table: TOML file that defines the columns

    Raises BadInputError if the table is None, if the log or the table is wrong, or if pyulog is
    missing.
    """
    if table is None:
        raise BadInputError(
            f"{path}: a log requires a file that defines the columns; add --columns FILE.toml"
        )
    data = read_toml(table)
    listed = _listed(table, data, model)
    log = _log(path)
    series = {each.name: _series(path, log, each) for each in listed}
    measured = {name: each for name, each in series.items() if name not in model.inputs}
    if not measured:
        raise BadInputError(
            f"{table} has no column of a measured state or output; add a column such as "
            f"{next(iter(model.states))}"
        )
    densest = max(measured, key=lambda name: len(measured[name][0]))
    time = _cut(table, data, series[densest][0], log.start_timestamp * _MICRO)
    columns = {"time": time - time[0]}
    for name, (stamps, values) in series.items():
        place = _held if name in model.inputs else _nearest
        columns[name] = place(time, stamps, values)
    return columns


def _listed(table: Path, data: Mapping[str, Any], model: Model) -> list[LoggedColumn]:
    """Return the columns that a table defines."""
    for key in data:
        refuse_unknown(f"{table}: unknown key", key, ("columns", "flight"))
    rows = data.get("columns")
    if not isinstance(rows, Mapping) or not rows:
        raise BadInputError(f"{table} has no [columns]; {_ADVICE}")
    listed = []
    for name, row in rows.items():
        known = (*model.inputs, *model.states, *model.outputs)
        refuse_unknown(f"{table}: unknown column", name, known)
        row = {"field": row} if isinstance(row, str) else row
        where = row.get("field") if isinstance(row, Mapping) else None
        message, dot, field = where.partition(".") if isinstance(where, str) else ("", "", "")
        if not (message and dot and field):
            raise BadInputError(f"{table}: {name} is {shown(row)}; {_ADVICE}")
        for key, value in row.items():
            refuse_unknown(f"{table}: {name} has the unknown key", key, ("field", *_NUMBERS))
            if key != "field" and not is_finite(value):
                raise BadInputError(f"{table}: {key} of {name} is {shown(value)}; give a number")
        numbers = {key: row.get(key, value) for key, value in _NUMBERS.items()}
        listed.append(LoggedColumn(name, message, field, **numbers))
    return listed


def _log(path: Path) -> Any:
    """Return the log as a pyulog object."""
    try:
        from pyulog import ULog
    except ModuleNotFoundError as error:
        raise missing_package("PX4 logs require", "pyulog") from error
    try:
        with path.open("rb") as file:
            return ULog(file)
    except OSError:
        raise
    except Exception as error:  # pyulog raises many kinds of errors for files that are not logs
        reason = str(error) or type(error).__name__
        raise BadInputError(f"{path} is not a PX4 log ({reason}); give a .ulg file") from error


def _series(path: Path, log: Any, column: LoggedColumn) -> tuple[np.ndarray, np.ndarray]:
    """Return the times, s, and the values of a column in the unit of the model, from a log."""
    messages = {(each.name, each.multi_id): each.data for each in log.data_list}
    names = sorted({name for name, _ in messages})
    refuse_unknown(f"{path} has no message", column.message, names)
    fields = messages.get((column.message, column.instance))
    if fields is None:
        raise BadInputError(
            f"{path}: {column.message} has no instance {column.instance}; correct or remove the "
            "entry instance"
        )
    if column.field in ("roll", "pitch", "yaw") and column.field not in fields:
        values = _angle(path, column, fields)
    else:
        refuse_unknown(f"{path}: {column.message} has no field", column.field, sorted(fields))
        values = np.asarray(fields[column.field], dtype=float)
    stamps = np.asarray(fields["timestamp"], dtype=float) * _MICRO
    return stamps, column.offset + column.scale * values


def _angle(path: Path, column: LoggedColumn, fields: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the roll, pitch or yaw angle computed from the quaternion of a message, rad, (N,)."""
    for name in ("q[0]", "q[1]", "q[2]", "q[3]"):
        refuse_unknown(f"{path}: {column.message} has no field", name, sorted(fields))
    w, x, y, z = (np.asarray(fields[f"q[{place}]"], dtype=float) for place in range(4))
    if column.field == "roll":
        return np.asarray(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)))
    if column.field == "pitch":
        return np.asarray(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _cut(table: Path, data: Mapping[str, Any], time: np.ndarray, begin: float) -> np.ndarray:
    """Return the times inside the interval [flight] of a table."""
    flight = data.get("flight", {})
    for key, value in flight.items():
        refuse_unknown(f"{table}: [flight] has the unknown key", key, ("begin", "end"))
        if not is_finite(value):
            raise BadInputError(
                f"{table}: {key} of [flight] is {shown(value)}; give a number of seconds"
            )
    since = time - begin
    inside = (since >= flight.get("begin", -np.inf)) & (since <= flight.get("end", np.inf))
    if not inside.any():
        ends = f"{since[0]:.1f} to {since[-1]:.1f} s"
        raise BadInputError(
            f"{table}: [flight] contains no samples; give times within the log, {ends}"
        )
    return time[inside]


def _held(time: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the last value at or before each time, NaN before the first sample, (N,)."""
    # time (N,), stamps (k,), values (k,)
    place = np.searchsorted(stamps, time, side="right") - 1
    return np.where(place >= 0, values[np.maximum(place, 0)], np.nan)


def _nearest(time: np.ndarray, stamps: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the value nearest to each time, NaN at other times, (N,)."""
    # Samples outside the times by more than half the median interval are omitted. If several
    # samples have the same nearest time, the last of these samples is used.
    # time (N,), stamps (k,), values (k,)
    edges = 0.5 * (time[:-1] + time[1:])
    half = 0.5 * float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    inside = (stamps >= time[0] - half) & (stamps <= time[-1] + half)
    column = np.full(len(time), np.nan)
    column[np.searchsorted(edges, stamps[inside])] = values[inside]
    return column
