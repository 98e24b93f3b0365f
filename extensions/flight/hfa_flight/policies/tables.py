"""Piecewise linear tables as CasADi expressions."""

from __future__ import annotations

import casadi as ca

from hfa_aircraft.rigid.tables import Interpolator, lines_of_cells
from hfa_support.matrices import LinearTable


def table_expression(table: LinearTable, where: ca.SX) -> ca.SX:
    """Return the value of a table at an argument, as a CasADi column (k,).

    The value of the table is an array with k entries. The column contains them row by row.

    where: argument of the table, one expression
    """
    points = table.breakpoints
    rows = table.values.reshape(len(points), -1)
    if len(points) == 1:
        return ca.SX(ca.DM(rows[0]))
    levels, slopes = lines_of_cells(rows, points)
    chosen, offset = Interpolator().cell(ca.SX(where), points)
    return ca.mtimes(ca.DM(levels).T, chosen) + offset * ca.mtimes(ca.DM(slopes).T, chosen)
