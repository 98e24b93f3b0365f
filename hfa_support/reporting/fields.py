"""What a value says that has no report of its own: its equation, and its fields with small matrices entry by entry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from hfa_support.reporting.checks import Check, checks_block
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, matrix_table, numbered

#: Matrices with more rows or columns, and longer lists, are said by their shape.
_MOST = 12
#: A field that is said in more characters breaks off.
_LONGEST = 110


class Shown(Reported):
    """A dataclass that shows its fields at the prompt, where arrays would fill the screen."""

    #: Properties that are shown before the fields: a verdict.
    says: ClassVar[tuple[str, ...]] = ()

    def report(self) -> Report:
        """The first line of the docstring, the fields, the matrices, the checks."""
        held = {name: getattr(self, name) for name in self.says}
        held |= {one.name: getattr(self, one.name) for one in fields(self)}  # type: ignore[arg-type]
        matrices = {name: value for name, value in held.items() if _is_matrix(value)}
        checks = {name: value for name, value in held.items() if isinstance(value, tuple) and _are_checks(value)}
        lines = [f"{name}: {_said(value)}" for name, value in held.items() if name not in {**matrices, **checks}]
        return Report(
            f"{type(self).__name__}: {(type(self).__doc__ or '').partition(chr(10))[0]}",
            [
                "\n".join(lines),
                *(_entries(name, matrix) for name, matrix in matrices.items()),
                *map(checks_block, checks.values()),
            ],
            data=held,
        )


def _entries(name: str, matrix: np.ndarray) -> Table:
    rows, columns = (numbered("", count) for count in matrix.shape)
    return matrix_table(name, rows, columns, matrix)


def _is_matrix(value: Any) -> bool:
    kept = isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "iuf"
    return kept and value.size > 0 and max(value.shape) <= _MOST


def _are_checks(values: tuple[Any, ...]) -> bool:
    return bool(values) and all(isinstance(each, Check) for each in values)


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
        yield type(value).__name__ if "array(" in text else text
