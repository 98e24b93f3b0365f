"""What a sweep says: as a table and as text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hfa_model.support.text import Table, columns, eigenvalue_text
from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES, entry_unit
from trim.point.condition import PAPER_RANGE
from trim.sweeps.sweep import Sweep
from trim.sweeps.sweep_plan import Steps, SweepPlan

#: The paper's range of dihedral with room for rounding, rad.
_LIMIT = PAPER_RANGE * (1 + 1e-12)


def sweep_table(result: Sweep) -> Table:
    """One row a point: the varied values, status, reason, operating point, eigenvalues, entries of A and B."""
    n = len(result.model_states)
    header = (
        *(f"{name} [{getattr(STATE_UNITS, name)}]" for name in result.variables),
        "status",
        "reason",
        *(f"state {name} [{getattr(STATE_UNITS, name)}]" for name in STATES),
        *(f"input {name} [{getattr(INPUT_UNITS, name)}]" for name in INPUTS),
        *(f"{part} eigenvalue {i + 1} [1/s]" for i in range(n) for part in ("real", "imaginary")),
        *(
            f"A({row}, {column}) [{entry_unit(row, column)}]"
            for row in result.model_states
            for column in result.model_states
        ),
        *(f"B({row}, {column}) [{entry_unit(row, column)}]" for row in result.model_states for column in INPUTS),
    )
    rows: list[tuple[Any, ...]] = []
    for i, reason in enumerate(result.reasons):
        eigenvalues = (part for value in result.eigenvalues[i] for part in (value.real, value.imag))
        rows.append(
            (
                *result.values[i],
                "failed" if reason else "trimmed",
                reason,
                *result.states[i],
                *result.inputs[i],
                *eigenvalues,
                *result.A[i].ravel(),
                *result.B[i].ravel(),
            )
        )
    return Table(header, rows)


def sweep_text(result: Sweep) -> str:
    """One line a point: the varied values and the eigenvalues of each mode, or why there is no trim.

    A conjugate pair has one column; where it splits into two real eigenvalues, both stand in it.
    """
    names = tuple(dict.fromkeys(result.mode_names))
    members = [[i for i, each in enumerate(result.mode_names) if each == name] for name in names]
    header = (
        *(f"{name} {_unit(name)}" for name in result.variables),
        *(f"{name} 1/s" for name in names),
    )
    rows, failures = [], []
    for i, reason in enumerate(result.reasons):
        values = tuple(_shown(name, value) for name, value in zip(result.variables, result.values[i], strict=True))
        if reason:
            rows.append((*values, *("-" for _ in names)))
            failures.append(f"{', '.join(values)}: {reason}")
        else:
            rows.append((*values, *(_mode_text(result.eigenvalues[i, columns_of]) for columns_of in members)))
    text = f"Sweep, {result.dynamics} dynamics: {int(result.trimmed.sum())} of {len(result.reasons)} points trimmed\n\n"
    return text + "\n".join([columns(header, rows), *failures])


def sweep_warnings(result: Sweep) -> list[str]:
    """What a user should know before trusting the sweep."""
    if "dihedral" not in result.variables:
        return []
    return _range_warnings(_beyond(result.values[:, result.variables.index("dihedral")]))


def plan_warnings(plan: SweepPlan) -> list[str]:
    """The same of a sweep of any size, before it runs; a grid is counted without making its points."""
    if "dihedral" not in plan.axes:
        return []
    dihedral = plan.axes["dihedral"]
    if plan.samples:
        return _range_warnings(_beyond(plan.values(0, plan.count)[:, plan.variables.index("dihedral")]))
    if not isinstance(dihedral, Steps):
        return _range_warnings(_beyond(np.array(dihedral)) * (plan.count // len(dihedral)))
    # Of i = 0 ... count - 1 the ones between `first` and `last` have -limit <= start + i step <= limit.
    first = max(math.ceil((-_LIMIT - dihedral.start) / dihedral.step), 0)
    last = min(math.floor((_LIMIT - dihedral.start) / dihedral.step), dihedral.count - 1)
    return _range_warnings((dihedral.count - max(last - first + 1, 0)) * (plan.count // dihedral.count))


def _beyond(dihedral: np.ndarray) -> int:
    return int(np.count_nonzero(np.abs(dihedral) > _LIMIT))


def _range_warnings(beyond: int) -> list[str]:
    if not beyond:
        return []
    limit = f"{math.degrees(PAPER_RANGE):.0f} deg"
    return [f"{beyond} points lie beyond the paper's range of dihedral, which ends at {limit}"]


def _unit(name: str) -> str:
    return str(getattr(STATE_UNITS, name)).replace("rad", "deg")


def _shown(name: str, value: float) -> str:
    return f"{math.degrees(value) if _unit(name) == 'deg' else value:.6g}"


def _mode_text(eigenvalues: np.ndarray) -> str:
    first = eigenvalues[0]
    # A pair says both its members at once.
    others = [value for value in eigenvalues[1:] if not (value.imag and value == first.conjugate())]
    return ", ".join(eigenvalue_text(value) for value in (first, *others))
