"""Search for a region of attraction by every prover that applies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NoReturn

import numpy as np

from hfa_prove.check import Proved
from hfa_prove.check.equilibrium import equilibrium_near
from hfa_prove.check.loop_on_ball import refuse_curved
from hfa_prove.search.clock import Clock
from hfa_prove.search.invariant import invariant_region
from hfa_prove.search.level import ProvedLevel
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet, first_obstacle, obstacles_around, rises
from hfa_prove.search.region_boxes import BoxesSearch
from hfa_prove.search.region_search import Region, RegionProblem, Settings
from hfa_prove.search.region_squares import SquaresSearch, region_of
from hfa_prove.search.shape_boxes import Shape
from hfa_prove.statements.loop import Gain
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress


def _by_squares(problem: RegionProblem, settings: Settings) -> Region:
    """Return the largest region, or invariant set under disturbances, proved by sums of squares.

    Raises NoSolutionError if no region is proved. Raises BadInputError if the policy is not a
    polynomial or the equations have no Taylor polynomials.
    """
    loop = problem.loop
    if not isinstance(loop.policy, Gain):
        raise BadInputError("sums of squares require a polynomial policy; use --prover boxes")
    if not loop.disturbances:
        return SquaresSearch(loop, problem.known, settings).found()
    refuse_curved(loop)
    undisturbed = replace(loop, disturbances={})
    with settings.clock.step(_OF_UNDISTURBED):
        found = SquaresSearch(undisturbed, problem.known, replace(settings, save=None)).found()
    return invariant_region(found, loop, settings.clock)


def _on_boxes(problem: RegionProblem, settings: Settings) -> Region:
    """Return the largest region that is proved on boxes.

    Raises NoSolutionError if no region is proved. Raises BadInputError if an operation of the
    equations is not enclosed.
    """
    return BoxesSearch(problem, settings).found()


#: Part of the time in which the set without disturbances is searched.
_OF_UNDISTURBED = 0.6
#: Part of the time limit in which the obstacles around the proved set are simulated at least.
_OF_OBSTACLES = 0.1
#: Name of a prover -> search for the largest region that it proves.
PROVERS: Mapping[str, Callable[[RegionProblem, Settings], Region]] = {
    "squares": _by_squares,
    "boxes": _on_boxes,
}


def provers_of(problem: RegionProblem) -> tuple[str, ...]:
    """Return the names of the provers that apply to a problem."""
    if problem.loop.disturbances:
        return ("squares",)
    return tuple(PROVERS) if isinstance(problem.loop.policy, Gain) else ("boxes",)


def region_of_certificate(proved: Proved, witness: Mapping[str, Any]) -> Region:
    """Return the region of a verified certificate.

    witness: data for the proof, as stored in the certificate
    """
    statement = proved.statement
    origin = "V of the certificate"
    if witness["prover"] == "squares":
        level = ProvedLevel(statement, dict(witness), proved.size)
        return region_of(level, LoopValues(statement.loop), origin)
    loop = statement.loop
    at = equilibrium_near(loop, np.array(list(loop.trim.values())))
    samples = LoopValues(loop, at.x)
    shape = Shape.of_piece(statement.piece, statement.degree)
    unit = shape.level_set()
    proved_set = LevelSet(unit.V.scaled(statement.rho), statement.rho, unit.T)
    extents = statement.extents
    return Region(statement, witness, proved.size, proved_set, extents, origin, samples)


def proved_region(
    problem: RegionProblem,
    provers: Sequence[str] = (),
    *,
    degree: int,
    seconds: float,
    progress: Progress | None = None,
    save: Callable[[Region], None] | None = None,
    earlier: Region | None = None,
) -> Region:
    """Return the largest region that is proved within the time limit.

    Each prover gets an equal part of the time that is left. After an interruption, the largest
    region proved so far is returned.

    provers: names in `PROVERS`, by default all that apply (`provers_of`)
    degree: highest degree of V
    seconds: limit of the processor time, s
    progress: called with the current step, or None
    save: called with each region that is larger than those proved before, or None
    earlier: region of an earlier run, from which its prover continues, or None

    Raises NoSolutionError if no region is proved. The message contains the reason of each prover.
    Raises BadInputError if no prover supports the equations.
    """
    clock = Clock(seconds, progress)
    names = provers or provers_of(problem)
    if earlier is not None:
        names = (earlier.prover,)
    found: dict[str, Region] = {}
    refused: dict[str, NoSolutionError | BadInputError] = {}

    def keep(region: Region) -> None:
        largest = max((each.set.size for each in found.values()), default=0.0)
        if region.set.size > largest and save is not None:
            save(region)

    for number, name in enumerate(names):
        try:
            with clock.step(1.0 / (len(names) - number)):
                found[name] = PROVERS[name](problem, Settings(degree, clock, keep, earlier))
        except (NoSolutionError, BadInputError) as error:
            refused[name] = error
        if clock.interrupted:
            break
    if not found:
        _refuse(refused)
    name = max(found, key=lambda name: found[name].set.size)
    region = found[name]
    others = {each: str(error) for each, error in refused.items()}
    for each in found.keys() - {name}:
        others[each] = (
            f"proves a set of {found[each].set.size / region.set.size:.3g} times the size"
        )
    return _with_obstacles(replace(region, others=others), seconds, clock)


def _refuse(refused: Mapping[str, NoSolutionError | BadInputError]) -> NoReturn:
    """Raise the error of a search in which no prover proves a region."""
    *_, last = refused.values()
    if all(isinstance(error, BadInputError) for error in refused.values()):
        raise last
    if len(refused) == 1:
        raise NoSolutionError(f"no region was proved: {last}")
    reasons = "; ".join(f"{name}: {error}" for name, error in refused.items())
    raise NoSolutionError(f"no region was proved by {' or '.join(refused)}: {reasons}")


def _with_obstacles(region: Region, seconds: float, clock: Clock) -> Region:
    """Return a region with the obstacles to a larger one.

    The simulations get the time that is left, at least `_OF_OBSTACLES` of the limit.
    """
    V, T = region.set.V, region.set.T
    rise = region.rise
    if rise is None:
        rise = first_obstacle(rises(region.loop, V.slope), region.set.level, 2.0 * T)
    left = Clock(max(clock.left, _OF_OBSTACLES * seconds))
    return replace(
        region, rise=rise, obstacles=obstacles_around(region.loop, region.set, rise, left)
    )
