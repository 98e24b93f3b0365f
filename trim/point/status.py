"""Status of operating points, and the tolerance of their equations."""

from __future__ import annotations

from enum import StrEnum

#: An equation balances if its scaled residual is at most this. The rounding of equations of usual
#: size, and the last Newton step, leave about 1e-14.
BALANCE = 1e-10
#: First column of what trims found, in a table of conditions. A file of conditions ends before it.
RESULTS = "results"
#: Columns of a table of conditions that are neither a variable nor a parameter.
NAME, FREE, LIMIT = "name", "free", "limit"
CLASS, CATEGORY = "class", "category"
#: First word of the heading of an imposed value, "hold alpha [deg]"; a trim has "alpha [deg]".
HELD = "hold"
#: Results of the trims in a table of conditions.
TRIMMED, STALLED, WARNED, UNTRIMMED = "trimmed", "stalled", "with a warning", "no trim"


class Status(StrEnum):
    """Status of an operating point.

    TRIMMED: the equations balance within the limits
    BEYOND_LIMITS: the equations balance only beyond a limit
    NO_TRIM: the equations do not balance
    FAILED: the search failed; the point is the best one within the limits
    """

    TRIMMED = "trimmed"
    BEYOND_LIMITS = "beyond limits"
    NO_TRIM = "no trim"
    FAILED = "failed"
