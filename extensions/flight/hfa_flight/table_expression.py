"""Linear tables as CasADi expressions."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from hfa_support.linear_table import LinearTable


def table_expression(table: LinearTable, where: ca.SX) -> ca.SX:
    """`table.at(where)` as an expression: v_0 + Σ_i (v_i+1 - v_i) sat((x - x_i)/(x_i+1 - x_i), 0,
    1).

    where: x, one expression

    Returns a column (k,) of the k entries of the array, row by row.
    """
    rows = table.values.reshape(len(table.breakpoints), -1)
    value = ca.SX(ca.DM(rows[0]))
    intervals = pairwise(table.breakpoints.tolist())
    differences = np.diff(rows, axis=0)
    for (low, high), difference in zip(intervals, differences, strict=True):
        share = ca.fmin(ca.fmax((where - low) / (high - low), 0.0), 1.0)
        value = value + ca.sparsify(ca.DM(difference)) * share
    return value
