"""What a grid of linear models says, and the same as a C function."""

from __future__ import annotations

from typing import Any

import numpy as np

from controller.export.c_model import comment_lines
from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS, UNITS, entry_unit
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table
from hfa_support.reporting.unit_system import gain_unit
from verification.proof.lpv_grid import LpvGrid

SCHEMA = "hfa.lpv/1"


def lpv_report(grid: LpvGrid, tolerance: float, dynamics: str) -> Report:
    """The proved bounds and where the nodes are; the matrices are data."""
    steps = np.diff(grid.dihedral_deg)
    low, high = grid.dihedral_deg[0], grid.dihedral_deg[-1]
    what = {
        "A": "|A - Â| / |A|",
        "B": "|B - B̂| / |B|",
        "inputs": "|U0 - Û0|, in units of the inputs",
        "K": "|K - K̂| / |K|",
    }
    rows = [(what[name], f"{value:.3g}") for name, value in grid.error.items()]
    data: dict[str, Any] = {
        "schema": SCHEMA,
        "dynamics": dynamics,
        "tolerance": tolerance,
        "error": grid.error,
        "dihedral_deg": grid.dihedral_deg,
        "A": grid.A,
        "B": grid.B,
        "inputs_offset": grid.inputs,
        "K": grid.K,
        "states": list(LINEAR_STATES),
        "inputs": list(INPUTS),
        "state_units": [getattr(STATE_UNITS, name) for name in LINEAR_STATES],
        "input_units": list(INPUT_UNITS),
    }
    return Report(
        title=f"Proved: {len(grid.dihedral_deg)} models from {low:g} to {high:g} deg, {dynamics} dynamics, interpolate "
        f"linearly within {tolerance:g}",
        parts=[
            Table(("error at every angle between, at most", "bound"), rows),
            f"steps from {steps.min():g} to {steps.max():g} deg",
        ],
        data=data,
        records=_records(grid),
    )


def c_source(grid: LpvGrid, origin: str) -> str:
    """A C99 function that interpolates A, B and U0, row by row; it needs no library. origin: said at its top."""
    count = len(grid.dihedral_deg)
    bounds = ", ".join(f"{name} {value:.3g}" for name, value in grid.error.items())
    tables = "\n".join(
        f"static const double {name}_at[{count}][{values[0].size}] = {{\n{_rows(values)}}};"
        for name, values in (("A", grid.A), ("B", grid.B), ("U0", grid.inputs), ("K", grid.K))
    )
    return f"""/* {comment_lines(origin)} */
/* Linear models of the aircraft over the dihedral, linear between the nodes; proved errors: {bounds}.
   States: {", ".join(LINEAR_STATES)}. Inputs: {", ".join(INPUTS)}. English units and radians; dihedral in degrees. */
#include <stddef.h>
static const double node_deg[{count}] = {{{_numbers(grid.dihedral_deg)}}};
{tables}
static void between(const double *first, const double *last, double share, size_t size, double *out)
{{
    for (size_t i = 0; i < size; i++) out[i] = first[i] + share * (last[i] - first[i]);
}}
/* A[36], B[30], U0[5] and the exact game's gain K[30], u = -K x; matrices row by row. Returns 0, or 1 and nothing when
   the dihedral is outside the nodes. */
int hfa_lpv(double dihedral_deg, double *A, double *B, double *U0, double *K)
{{
    size_t k = 0;
    if (!(dihedral_deg >= node_deg[0] && dihedral_deg <= node_deg[{count - 1}])) return 1;
    while (k + 2 < {count} && dihedral_deg > node_deg[k + 1]) k++;
    double share = (dihedral_deg - node_deg[k]) / (node_deg[k + 1] - node_deg[k]);
    between(A_at[k], A_at[k + 1], share, 36, A);
    between(B_at[k], B_at[k + 1], share, 30, B);
    between(U0_at[k], U0_at[k + 1], share, 5, U0);
    between(K_at[k], K_at[k + 1], share, 30, K);
    return 0;
}}
"""


def _rows(values: np.ndarray) -> str:
    return "".join(f"    {{{_numbers(each)}}},\n" for each in values)


def _numbers(values: np.ndarray) -> str:
    return ", ".join(repr(value) for value in np.ravel(values).tolist())


def _records(grid: LpvGrid) -> Table:
    rows = []
    for k, angle in enumerate(grid.dihedral_deg.tolist()):
        for name, matrix, names, columns, unit in (
            ("A", grid.A[k], LINEAR_STATES, LINEAR_STATES, entry_unit),
            ("B", grid.B[k], LINEAR_STATES, INPUTS, entry_unit),
            ("K", grid.K[k], INPUTS, LINEAR_STATES, lambda row, column: gain_unit(UNITS[row], UNITS[column])),
        ):
            rows += [
                (angle, name, row, column, matrix[i, j], unit(row, column))
                for i, row in enumerate(names)
                for j, column in enumerate(columns)
            ]
        offsets = zip(INPUTS, grid.inputs[k].tolist(), INPUT_UNITS, strict=True)
        rows += [(angle, "U0", name, "", value, unit) for name, value, unit in offsets]
    return Table(("dihedral_deg", "matrix", "row", "column", "value", "unit"), rows)
