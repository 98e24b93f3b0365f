"""What a sweep says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hfa_model.reporting.report import Block, Picture, Report
from hfa_model.reporting.text import RowsMade, Table, angle_text, eigenvalue_text, shown_unit, shown_value
from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES, entry_unit
from trim.point.condition import PAPER_RANGE
from trim.point.operating_point import Status
from trim.sweeps.sweep import Sweep
from trim.sweeps.sweep_plan import Steps, SweepPlan

#: The paper's range of dihedral with room for rounding, rad.
_LIMIT = PAPER_RANGE * (1 + 1e-12)


def sweep_report(result: Sweep) -> Report:
    """One line a point: the varied values and the eigenvalues of each mode, or why there is no trim.

    A conjugate pair has one column; where it splits into two real eigenvalues, both stand in it.
    """
    modes = tuple(dict.fromkeys(result.mode_names))
    members = [[i for i, each in enumerate(result.mode_names) if each == name] for name in modes]

    def varied(i: int) -> tuple[str, ...]:
        return tuple(map(shown_value, result.values[i], result.units))

    def row(i: int) -> tuple[str, ...]:
        if result.reasons[i]:
            return *varied(i), *("-" for _ in modes)
        return *varied(i), *(_mode_text(result.eigenvalues[i, columns]) for columns in members)

    count, warnings = len(result.reasons), sweep_warnings(result)
    header = (
        *(f"{name} {shown_unit(unit)}" for name, unit in zip(result.variables, result.units, strict=True)),
        *(f"{name} 1/s" for name in modes),
    )
    failures = [f"{', '.join(varied(i))}: {reason}" for i, reason in enumerate(result.reasons) if reason]
    return Report(
        title=f"Sweep, {result.dynamics} dynamics: {int(result.trimmed.sum())} of {count} points trimmed",
        parts=(Block((Table(header, RowsMade(count, row)), *failures)), *_root_locus(result)),
        notes=warnings,
        data=result.to_dict() | {"warnings": warnings},
        records=_records(result),
    )


def _root_locus(result: Sweep) -> tuple[Picture, ...]:
    """The picture of a sweep in one variable."""
    from trim.sweeps.root_locus import root_locus_figure

    moving = np.ptp(result.values, axis=0) > 0
    if not result.mode_names or moving.sum() != 1 or not moving[-1]:
        return ()
    text = f"Eigenvalues over {result.variables[-1]}"
    return (Picture("root_locus.png", text, lambda: root_locus_figure(result)),)


def _records(result: Sweep) -> Table:
    """One row a point: the varied values, status, reason, operating point, eigenvalues, entries of A and B."""
    n = len(result.model_states)
    header = (
        *(f"{name} [{unit}]" for name, unit in zip(result.variables, result.units, strict=True)),
        "status",
        "reason",
        *(f"state {name} [{getattr(STATE_UNITS, name)}]" for name in STATES),
        *(f"input {name} [{getattr(INPUT_UNITS, name)}]" for name in INPUTS),
        *(f"{part} eigenvalue {i + 1} [1/s]" for i in range(n) for part in ("real", "imaginary")),
        *(
            f"{matrix}({row}, {column}) [{entry_unit(row, column)}]"
            for matrix, names in (("A", result.model_states), ("B", INPUTS))
            for row in result.model_states
            for column in names
        ),
    )

    def row(i: int) -> tuple[Any, ...]:
        return (
            *result.values[i],
            str(Status.FAILED if result.reasons[i] else Status.TRIMMED),
            result.reasons[i],
            *result.states[i],
            *result.inputs[i],
            *(part for value in result.eigenvalues[i] for part in (value.real, value.imag)),
            *result.A[i].ravel(),
            *result.B[i].ravel(),
        )

    return Table(header, RowsMade(len(result.reasons), row))


def sweep_warnings(result: Sweep) -> list[str]:
    """What a user should know before trusting the sweep."""
    if "dihedral" not in result.variables:
        return []
    return _range_warnings(_beyond(result.values[:, result.variables.index("dihedral")]), len(result.values))


def plan_warnings(plan: SweepPlan) -> list[str]:
    """The same of a sweep of any size, before it runs; a grid is counted without making its points."""
    if "dihedral" not in plan.axes:
        return []
    dihedral = plan.axes["dihedral"]
    if plan.samples:
        return _range_warnings(_beyond(plan.values(0, plan.count)[:, plan.variables.index("dihedral")]), plan.count)
    if not isinstance(dihedral, Steps):
        return _range_warnings(_beyond(np.array(dihedral)) * (plan.count // len(dihedral)), plan.count)
    # Of i = 0 ... count - 1 the ones between `first` and `last` have -limit <= start + i step <= limit.
    first = max(math.ceil((-_LIMIT - dihedral.start) / dihedral.step), 0)
    last = min(math.floor((_LIMIT - dihedral.start) / dihedral.step), dihedral.count - 1)
    beyond = dihedral.count - max(last - first + 1, 0)
    return _range_warnings(beyond * (plan.count // dihedral.count), plan.count)


def _beyond(dihedral: np.ndarray) -> int:
    return int(np.count_nonzero(np.abs(dihedral) > _LIMIT))


def _range_warnings(beyond: int, count: int) -> list[str]:
    if not beyond:
        return []
    points = f"{beyond} of {count} points {'lies' if beyond == 1 else 'lie'}" if count > 1 else "the point lies"
    return [f"{points} beyond the paper's range of dihedral, which ends at {angle_text(PAPER_RANGE)}"]


def _mode_text(eigenvalues: np.ndarray) -> str:
    first = eigenvalues[0]
    # A pair says both its members at once.
    others = [value for value in eigenvalues[1:] if not (value.imag and value == first.conjugate())]
    return ", ".join(eigenvalue_text(value) for value in (first, *others))
