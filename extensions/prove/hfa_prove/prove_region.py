"""`hfa.prove_region`: the command `hfa prove region` for a gain, as a function."""

from __future__ import annotations

from typing import Any

from hfa_aircraft.model import Model
from hfa_prove.problem import loop_at
from hfa_prove.search.region import proved_region
from hfa_prove.search.region_search import Region, RegionProblem
from hfa_prove.statements.loop import Gain
from hfa_support.errors import BadInputError, numbers_in
from hfa_support.progress import Progress
from trim.point.operating_point import OperatingPoint


def prove_region(
    model: Model,
    point: OperatingPoint,
    K: Any,
    *,
    seconds: float = 60.0,
    degree: int = 2,
    progress: Progress | None = None,
) -> Region:
    """Return a proved region of attraction of the nonlinear loop u = sat(u0 - K (x - x0)).

    model: the aircraft
    point: trim x0, u0 of this aircraft
    K: gain from states to inputs of the linear model, (m, n), or an object with the attribute K
    seconds: limit of the processor time of the search, s
    degree: highest degree of V
    progress: called with the current step, or None. A KeyboardInterrupt from the callback ends the
        search.

    Raises NoSolutionError if no region is proved. Raises BadInputError if the equations cannot be
    enclosed, K has another shape, or the point belongs to another model.

    >>> import hfa
    >>> region = hfa.prove_region(model, point, K, seconds=60.0)  # doctest: +SKIP
    """
    linear = point.linearize()
    point._refuse_other(model)
    gain = numbers_in("K", getattr(K, "K", K))
    wanted = (len(linear.inputs), len(linear.states))
    if gain.shape != wanted:
        raise BadInputError(f"K has the shape {gain.shape}; give {wanted}, inputs x states")
    problem = RegionProblem(loop_at(linear, Gain(gain, {})))
    return proved_region(problem, degree=degree, seconds=seconds, progress=progress)
