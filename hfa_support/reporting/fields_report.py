"""Report of the fields of a dataclass, including small matrices and checks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from hfa_support.errors import shortened
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import matrix_table, numbered

#: Largest size of matrices and arrays whose entries are shown.
_MOST = 12
#: Largest number of characters of a field.
_LONGEST = 110


def fields_report(result: Any) -> Report:
    """Return a report of a dataclass: summary line, fields, small matrices and checks.

    The summary line is the name of the class and the first line of its docstring. Empty fields and
    fields with repr=False are omitted.
    """
    held = {field.name: getattr(result, field.name) for field in fields(result) if field.repr}
    lines: list[str] = []
    matrices: list[Part] = []
    checks: list[Part] = []
    for name, value in held.items():
        is_matrix = isinstance(value, np.ndarray) and value.ndim == 2 and value.size > 0
        if is_matrix and max(value.shape) <= _MOST:
            rows, columns = (numbered("", count) for count in value.shape)
            matrices.append(matrix_table(name, rows, columns, value))
        elif isinstance(value, tuple) and value and isinstance(value[0], Check):
            checks.append(checks_block(value))
        elif (text := _on_one_line(value)) != "-":
            lines.append(f"{name}: {text}")
    kind = type(result)
    first_line = (kind.__doc__ or "").partition("\n")[0]
    title = f"{kind.__name__}: {first_line}"
    return Report(title, ["\n".join(lines), *matrices, *checks], data=held)


def _on_one_line(value: Any) -> str:
    """Return a value as one short line of text, or "-" if it is empty.

    A long array is described by its shape, and another result by its type.
    """
    fields = value._asdict() if hasattr(value, "_asdict") else value
    if value is None:
        text = ""
    elif isinstance(value, np.ndarray) and (value.ndim != 1 or value.size > _MOST):
        text = f"an array of shape {value.shape}"
    elif isinstance(fields, Mapping):
        text = ", ".join(f"{name} {_on_one_line(entry)}" for name, entry in fields.items())
    elif isinstance(value, (tuple, list, np.ndarray)):
        text = ", ".join(map(_on_one_line, value))
    elif isinstance(value, (float, np.floating)):
        text = f"{value:.6g}"
    elif isinstance(value, Reported):
        text = type(value).__name__
    else:
        text = str(value)
    if "array(" in text or " object at 0x" in text:
        text = type(value).__name__
    return shortened(" ".join(text.split()) or "-", _LONGEST)
