"""Dataclasses of arrays: compared as values; shown at the prompt with their fields, small matrices entry by entry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import matrix_table, numbered

#: Matrices with more rows or columns, and longer lists, are said by their shape.
_MOST = 12
#: A field that is said in more characters breaks off.
_LONGEST = 110


class ByValue:
    """A dataclass (`eq=False`) that equals another when every field does, arrays entry by entry and nan like nan.

    The comparison that `dataclass` writes asks an array for its truth and raises.
    """

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return all(_same(getattr(self, one.name), getattr(other, one.name)) for one in fields(self) if one.compare)  # type: ignore[arg-type]


class Shown(Reported):
    """A dataclass that shows its fields at the prompt, where arrays would fill the screen."""

    #: Properties that are shown before the fields: a verdict.
    says: ClassVar[tuple[str, ...]] = ()

    def report(self) -> Report:
        """The first line of the docstring, the fields, small matrices, the checks."""
        held = {name: getattr(self, name) for name in (*self.says, *(one.name for one in fields(self)))}  # type: ignore[arg-type]
        lines: list[str] = []
        matrices: list[Part] = []
        checks: list[Part] = []
        for name, value in held.items():
            if isinstance(value, np.ndarray) and value.ndim == 2 and value.size and max(value.shape) <= _MOST:
                rows, columns = (numbered("", count) for count in value.shape)
                matrices.append(matrix_table(name, rows, columns, value))
            elif isinstance(value, tuple) and value and isinstance(value[0], Check):
                checks.append(checks_block(value))
            else:
                lines.append(f"{name}: {_said(value)}")
        title = f"{type(self).__name__}: {(type(self).__doc__ or '').partition(chr(10))[0]}"
        return Report(title, ["\n".join(lines), *matrices, *checks], data=held)


def _said(value: Any) -> str:
    text = " ".join(", ".join(_parts(value)).split()) or "-"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def _parts(value: Any) -> Iterator[str]:
    if isinstance(value, np.ndarray) and (value.ndim != 1 or value.size > _MOST):
        yield f"an array of shape {value.shape}"
    elif isinstance(value, Mapping):
        yield from (f"{name} {_said(each)}" for name, each in value.items())
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        yield from _parts(value._asdict())
    elif isinstance(value, (tuple, list, np.ndarray)):
        yield from map(_said, value)
    elif isinstance(value, Shown):
        yield type(value).__name__
    elif isinstance(value, Reported):
        yield value.report().title.partition("\n")[0]
    elif isinstance(value, (float, np.floating)):
        yield f"{value:.6g}"
    elif value is not None:
        text = str(value)
        yield type(value).__name__ if "array(" in text or " object at 0x" in text else text


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind in "fc" and other.dtype.kind in "fc")
    return bool(one == other)
