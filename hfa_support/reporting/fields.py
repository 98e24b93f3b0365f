"""Dataclasses of arrays shown at the prompt with their fields, small matrices entry by entry."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from hfa_support.errors import shortened
from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import matrix_table, numbered

#: Of larger matrices and longer arrays the shape is shown.
_MOST = 12
#: Characters of a field that are shown.
_LONGEST = 110


class Shown(Reported):
    """A dataclass that shows its fields at the prompt, where arrays would fill the screen."""

    def report(self) -> Report:
        """The first line of the docstring, the fields, small matrices, the checks."""
        held = {field.name: getattr(self, field.name) for field in fields(self)}  # type: ignore[arg-type]
        lines: list[str] = []
        matrices: list[Part] = []
        checks: list[Part] = []
        for name, value in held.items():
            if (
                isinstance(value, np.ndarray)
                and value.ndim == 2
                and value.size
                and max(value.shape) <= _MOST
            ):
                rows, columns = (numbered("", count) for count in value.shape)
                matrices.append(matrix_table(name, rows, columns, value))
            elif isinstance(value, tuple) and value and isinstance(value[0], Check):
                checks.append(checks_block(value))
            else:
                lines.append(f"{name}: {_said(value)}")
        title = f"{type(self).__name__}: {(type(self).__doc__ or '').partition(chr(10))[0]}"
        return Report(title, ["\n".join(lines), *matrices, *checks], data=held)


def _said(value: Any) -> str:
    """A value on one line, shortened; of long arrays their shape, of other results their kind."""
    fields = value._asdict() if hasattr(value, "_asdict") else value
    if isinstance(value, np.ndarray) and (value.ndim != 1 or value.size > _MOST):
        text = f"an array of shape {value.shape}"
    elif isinstance(fields, Mapping):
        text = ", ".join(f"{name} {_said(entry)}" for name, entry in fields.items())
    elif isinstance(value, (tuple, list, np.ndarray)):
        text = ", ".join(map(_said, value))
    elif isinstance(value, (float, np.floating)):
        text = f"{value:.6g}"
    else:
        text = (
            ""
            if value is None
            else type(value).__name__
            if isinstance(value, Reported)
            else str(value)
        )
    if "array(" in text or " object at 0x" in text:
        text = type(value).__name__
    return shortened(" ".join(text.split()) or "-", _LONGEST)
