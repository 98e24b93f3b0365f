"""Search for a region of attraction, or for a set that is invariant under disturbances."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from hfa_prove.check.cover import OpenBoxError
from hfa_prove.check.region_boxes import refuse_curved
from hfa_prove.fields import Rejected
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.loop_values import DisturbedValues
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import Region, RegionProblem, Settings
from hfa_prove.search.shape_boxes import Shape
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress

#: Part of the time in which V is searched without disturbances.
_OF_UNDISTURBED = 0.6
#: Number of V with the largest sampled sets under disturbances for which a proof is tried, and the
#: part of the time left for one proof.
_TRIED = 3
_OF_ONE = 0.5
#: Sampled levels of a V, relative to its level without disturbances, and points on each.
_LEVELS = np.geomspace(1.0, 1e-3, 120)
_POINTS = 3000
#: Shares of the sampled level that are tried until one is proved.
_SHARES = (0.99, 0.96, 0.92, 0.85, 0.7, 0.5, 0.3)


def proved_region(
    problem: RegionProblem,
    *,
    degree: int,
    seconds: float,
    progress: Progress | None = None,
    save: Callable[[Region], None] | None = None,
) -> Region:
    """Return the largest region that is proved within the time limit.

    With disturbances, the result is a set that is invariant under them. After an interruption, the
    largest set proved so far is returned.

    degree: highest degree of V
    seconds: limit of the processor time, s
    progress: called with the current step, or None
    save: called with each region that is larger than those proved before, or None

    Raises NoSolutionError if no region is proved. Raises BadInputError if an operation of the
    equations is not enclosed, or the rates are not affine in the disturbances.
    """
    settings = Settings(degree, Clock(seconds, progress), save)
    try:
        if problem.loop.disturbances:
            return _invariant_set(problem, settings)
        return BoxesSearch(problem, settings).found()
    except NoSolutionError as error:
        raise NoSolutionError(f"no region was proved: {error}") from error


def _invariant_set(problem: RegionProblem, settings: Settings) -> Region:
    """Return the largest proved invariant set, with a V of the search without disturbances."""
    refuse_curved(problem.loop)
    clock = settings.clock
    still: list[Region] = []
    search = BoxesSearch(problem, replace(settings, save=still.append))
    with clock.step(_OF_UNDISTURBED):
        search.found()
    shapes = [(region.origin, region.set) for region in reversed(still)]
    best: Region | None = None
    stopped = ""
    sampled = sorted(_sampled(search, problem, shapes + search.firsts), key=lambda each: -each[0])
    try:
        for _, origin, shape in sampled[:_TRIED]:
            for share in _SHARES:
                part = search.part(shape, float(np.sqrt(share)))
                if best is not None and part.size() <= best.set.size():
                    break
                try:
                    with clock.step(_OF_ONE):
                        best = search.proved(problem.loop, part, origin)
                except (OpenBoxError, Rejected, OutOfTimeError) as error:
                    stopped = f"{share:g} of the level by samples: {error}"
                    continue
                if settings.save is not None:
                    settings.save(best)
                break
    except KeyboardInterrupt:
        stopped = "interrupted"
    if best is None:
        raise NoSolutionError(
            stopped or "for every V tried, V' >= 0 somewhere on each level; reduce the disturbance"
        )
    return replace(best, stopped=stopped)


def _sampled(
    search: BoxesSearch, problem: RegionProblem, shapes: list[tuple[str, Shape]]
) -> Iterator[tuple[float, str, Shape]]:
    """Yield size, description and V of the largest level with V' < 0 at all samples."""
    for origin, shape in shapes:
        values = DisturbedValues(problem.loop, search.equilibrium.x, shape.gradients)
        for level in _LEVELS.tolist():
            at_level = shape.of_level(level)
            z = at_level.edge_points(_POINTS) @ shape.N.T
            with np.errstate(all="ignore"):
                slopes = np.sum(shape.gradients(z) * values.rates(z), axis=1)
            if np.all(slopes < 0.0) and not np.any(values.away(z)):
                yield at_level.size(), origin, at_level
                break
