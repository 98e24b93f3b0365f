"""What a sweep says: as a table and as text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from hfa_model.vectors import INPUT_UNITS, INPUTS, STATE_UNITS, STATES, entry_unit
from trim.sweep import PAPER_RANGE, Sweep
from trim.text import Table, columns


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
    return header, rows


def sweep_text(result: Sweep) -> str:
    """One line a point: the varied values and the eigenvalue of each mode, or why there is no trim."""
    shown = [i for i, name in enumerate(result.mode_names) if name not in result.mode_names[:i]]
    header = (
        *(f"{name} {_unit(name)}" for name in result.variables),
        *(f"{result.mode_names[i]} 1/s" for i in shown),
    )
    rows, failures = [], []
    for i, reason in enumerate(result.reasons):
        values = tuple(_shown(name, value) for name, value in zip(result.variables, result.values[i], strict=True))
        if reason:
            rows.append((*values, *("-" for _ in shown)))
            failures.append(f"{', '.join(values)}: {reason}")
        else:
            rows.append((*values, *(_eigenvalue(result.eigenvalues[i, k]) for k in shown)))
    text = f"Sweep, {result.dynamics} dynamics: {int(result.trimmed.sum())} of {len(result.reasons)} points trimmed\n\n"
    return text + "\n".join([columns(header, rows), *failures])


def sweep_warnings(result: Sweep) -> list[str]:
    """What a user should know before trusting the sweep."""
    if "dihedral" not in result.variables:
        return []
    dihedral = result.values[:, result.variables.index("dihedral")]
    beyond = int(np.count_nonzero(np.abs(dihedral) > PAPER_RANGE * (1 + 1e-12)))
    if not beyond:
        return []
    limit = f"{math.degrees(PAPER_RANGE):.0f} deg"
    return [f"{beyond} points lie beyond the paper's range of dihedral, which ends at {limit}"]


def _unit(name: str) -> str:
    return str(getattr(STATE_UNITS, name)).replace("rad", "deg")


def _shown(name: str, value: float) -> str:
    return f"{math.degrees(value) if _unit(name) == 'deg' else value:.6g}"


def _eigenvalue(value: complex) -> str:
    return f"{value.real:.4f}" + (f" ± {abs(value.imag):.4f}i" if value.imag else "")
