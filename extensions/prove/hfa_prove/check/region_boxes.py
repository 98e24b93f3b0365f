"""Checker of a region of attraction, by subdivision into boxes.

Theorem. Let z be the deviation from the equilibrium, y = M z, and S = {V <= rho} within the cube
|y_i| <= 1. Suppose that S meets no face of the cube, that V' < 0 in S except at the equilibrium,
and that all limits hold in S. Then every trajectory that begins in S exists for all time, stays in
S and converges to the equilibrium (LaSalle). Where the equations switch, trajectories are Filippov
solutions.

Of the search, the checker uses the multipliers of the extents and the number of boxes after which
the checker stops.
"""

from __future__ import annotations

import numpy as np

from hfa_prove.check.equilibrium import check_near
from hfa_prove.check.loop_boxes import Decrease, equilibrium_near
from hfa_prove.fields import Rejected
from hfa_prove.statements.region import BoxWitness, RegionStatement
from hfa_support.progress import Progress


def check_region(
    statement: RegionStatement, witness: BoxWitness, progress: Progress | None = None
) -> int:
    """Prove a statement about a region and return the number of boxes that the proof evaluated.

    Raises Rejected if the statement is not proved.
    """
    loop = statement.loop
    if loop.disturbances or statement.piece.whole:
        raise Rejected("boxes prove sets in |y_i| < 1 without disturbances only")
    stated = np.array(list(statement.equilibrium.values()))
    equilibrium = equilibrium_near(loop, stated)
    check_near(equilibrium, stated, loop.nominal[: len(loop.states)], "the stated one")
    extents = np.array([statement.extents[name] for name in loop.states])
    decrease = Decrease(loop, equilibrium, statement.piece, extents, witness.multipliers)
    return decrease.proved(witness.boxes, progress)
