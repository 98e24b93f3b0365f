"""How much of a sweep lies beyond the paper's range of dihedral."""

from __future__ import annotations

import math

import numpy as np

from hfa_model.reporting.text import angle_text
from trim.point.condition import PAPER_LIMIT, PAPER_RANGE
from trim.sweeps.sweep_plan import Steps, SweepPlan


def range_warnings(dihedral: np.ndarray) -> list[str]:
    """What a user should know before trusting results at these angles, rad."""
    return _warnings(_beyond(dihedral), len(dihedral))


def plan_warnings(plan: SweepPlan) -> list[str]:
    """The same of a sweep of any size before it runs; a grid is counted without making its points."""
    if "dihedral" not in plan.axes:
        return []
    dihedral = plan.axes["dihedral"]
    if plan.samples:
        return range_warnings(plan.values(0, plan.count)[:, plan.variables.index("dihedral")])
    if not isinstance(dihedral, Steps):
        return _warnings(_beyond(np.array(dihedral)) * (plan.count // len(dihedral)), plan.count)
    # Of i = 0 ... count - 1 the ones between `first` and `last` have -limit <= start + i step <= limit.
    first = max(math.ceil((-PAPER_LIMIT - dihedral.start) / dihedral.step), 0)
    last = min(math.floor((PAPER_LIMIT - dihedral.start) / dihedral.step), dihedral.count - 1)
    beyond = dihedral.count - max(last - first + 1, 0)
    return _warnings(beyond * (plan.count // dihedral.count), plan.count)


def _beyond(dihedral: np.ndarray) -> int:
    return int(np.count_nonzero(np.abs(dihedral) > PAPER_LIMIT))


def _warnings(beyond: int, count: int) -> list[str]:
    if not beyond:
        return []
    points = f"{beyond} of {count} points {'lies' if beyond == 1 else 'lie'}" if count > 1 else "the point lies"
    return [f"{points} beyond the paper's range of dihedral, which ends at {angle_text(PAPER_RANGE)}"]
