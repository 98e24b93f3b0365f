"""Search for a large set that is proved invariant under disturbances."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import casadi as ca
import numpy as np

from hfa_prove.monomials import PolynomialFunction, edge_points
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.level import LevelSearch, ProvedLevel, Setting, accepted, holding_ball
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet
from hfa_prove.search.region_search import Region, lyapunov_matrices
from hfa_prove.search.region_squares import LYAPUNOV, origin_of, region_of, settings_of
from hfa_prove.search.squares import ONE, Terms
from hfa_prove.statements.loop import HIGHEST, LOWEST, Loop
from hfa_prove.statements.region import ANY, EDGE, LEVEL
from hfa_support.errors import NoSolutionError

#: Number of Lyapunov matrices that are tried besides V of the loop without disturbance.
_CANDIDATES = 6
#: Number of V with the largest sampled sets for which a proof is tried.
_TRIED = 4
#: Sampled levels of a V whose level 1 is about the largest.
_LEVELS = np.geomspace(2.0, 1e-3, 30)
#: Bisections between two sampled levels.
_FINER = 4
#: Decreasing shares of the sampled level for which a proof is tried.
_SHARES = (0.99, 0.95, 0.9, 0.8, 0.65, 0.5, 0.3)
#: Bisections between the largest proved share and the next larger one.
_STEPS = 4


class DisturbedLoop(LoopValues):
    """The closed loop under the disturbance that increases V fastest at each state.

    loop: the loop with its disturbances
    V: the polynomial V
    """

    def __init__(self, loop: Loop, V: PolynomialFunction) -> None:
        super().__init__(loop)
        self.V = V

    @cached_property
    def _winds(self) -> ca.Function:
        """Function x -> ∂x'/∂w as a vector (n d,), the columns of the matrix (n, d) in order."""
        loop = self.loop
        x = ca.SX.sym("x", len(loop.states))
        w = ca.SX.sym("w", len(loop.disturbances))
        acting = dict(zip(loop.disturbances, ca.vertsplit(w), strict=True))
        every = [acting.get(name, 0.0) for name in loop.model.disturbances]
        rates, _ = loop.rates_at(x, loop.commands(x), every)
        slopes = ca.substitute(ca.jacobian(rates, w), w, 0)
        return ca.Function("winds", [x], [ca.densify(ca.vec(slopes))])

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return z' (N, n) at state deviations z (N, n) under the worst disturbance.

        The worst disturbance increases V fastest.
        """
        count, n = z.shape
        sizes = np.array(list(self.loop.disturbances.values()))
        by_wind = np.array(self._winds((z + self._x).T)).T.reshape(count, len(sizes), n)
        raised = np.einsum("kdn,kn->kd", by_wind, self.V.slope(z))
        worst = np.where(raised >= 0.0, sizes, -sizes)
        return super().rates(z) + np.einsum("kdn,kd->kn", by_wind, worst)


class EdgeSearch(LevelSearch):
    """Search for proved levels of one V on whose boundary V' < 0 under all disturbances."""

    def _split(self) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
        """Return the parts on which V' < 0 is to be proved, and the parts to be proved empty.

        The parts of the inputs are combined with the lowest and the highest value of every
        disturbance. An empty part covers all values of the disturbances.
        """
        names = self.statement.loop.disturbances
        parts, empty = super()._split()
        parts_at_ends = []
        for part in parts:
            for ends in product((LOWEST, HIGHEST), repeat=len(names)):
                parts_at_ends.append(part | dict(zip(names, ends, strict=True)))
        return parts_at_ends, [part | dict.fromkeys(names, ANY) for part in empty]

    def _level_constraints(self, share: float) -> dict[str, Terms]:
        """Return the two constraints that define {V = share rho}, by name.

        The polynomials are share - V / rho and V / rho - share.

        share: the level as a share of rho
        """
        edge = self.V_terms + ONE.scaled(-share)
        return {LEVEL: edge.scaled(-1.0), EDGE: edge}


def invariant_region(region: Region, loop: Loop, clock: Clock) -> Region:
    """Return the largest set that is proved invariant under disturbances.

    At the time limit or after an interruption, the largest set proved so far is returned.

    region: proved region of the loop without disturbance
    loop: the loop with its disturbances

    Raises NoSolutionError if no set is proved.
    """
    best: Region | None = None
    stopped = ""
    try:
        candidates = sorted(_sampled(loop, region), key=lambda candidate: -candidate.size)[:_TRIED]
        for index, candidate in enumerate(candidates):
            clock(index, len(candidates), f"proving {candidate.origin}")
            if best is not None and candidate.size <= best.set.size:
                break
            proved = _largest(loop, candidate, clock)
            if proved is None:
                continue
            found = region_of(proved, candidate.plant, candidate.origin, candidate.beyond)
            if best is None or found.set.size > best.set.size:
                best = found
    except OutOfTimeError as error:
        stopped = str(error)
    except KeyboardInterrupt:
        stopped = "interrupted"
    if best is None:
        raise NoSolutionError(
            stopped
            or "no set is proved invariant under a disturbance of this size: for every V tried, "
            "V' >= 0 somewhere on each level, or no level was proved; reduce the disturbance"
        )
    return replace(best, stopped=stopped)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A V that decreases at samples of one of its levels, under the worst disturbance.

    V: the polynomial V
    origin: description of V
    plant: the loop under the worst disturbance
    T: coordinates z = T y in which the sets of V are measured, (n, n)
    level: highest level found with V' < 0 and the limits satisfied at all samples
    size: size of the set of this level
    beyond: the next level that was tried and a state on it with V' >= 0, or (inf, None) if no such
        state was found
    """

    V: PolynomialFunction
    origin: str
    plant: DisturbedLoop
    T: np.ndarray
    level: float
    size: float
    beyond: tuple[float, np.ndarray | None]


def _functions(region: Region) -> Iterator[tuple[str, PolynomialFunction]]:
    """Yield pairs of a description and a V, in this order:

    - V of the loop without disturbance
    - the other V that the search for that V tried. A V with a smaller set may prove more under a
      disturbance.
    - Lyapunov functions of the linear loop, scaled to similar sets

    region: proved region of the loop without disturbance
    """
    V, rho, T = region.set.V, region.set.rho, region.set.T
    yield region.origin, V.scaled(1.0 / rho)
    for tried in region.tried:
        yield origin_of(tried), tried
    points = edge_points(V, T, rho) @ T.T
    for P in lyapunov_matrices(region.loop.J, region.loop.nominal, _CANDIDATES):
        V = PolynomialFunction.quadratic(P)
        yield LYAPUNOV, V.scaled(1.0 / float(np.median(V(points))))


def _sampled(loop: Loop, region: Region) -> Iterator[_Candidate]:
    """Yield a candidate for each V that has a level with V' < 0 at all samples.

    loop: the loop with its disturbances
    region: proved region of the loop without disturbance
    """
    for origin, V in _functions(region):
        plant = DisturbedLoop(loop, V)
        T = V.coordinates()
        falling = (level for level in _LEVELS.tolist() if _falls(plant, V, T, level)[0])
        highest = next(falling, None)
        if highest is None:
            continue
        level, above = _bisected(plant, V, T, highest)
        _, place = _falls(plant, V, T, above)
        beyond = (np.inf, None) if place is None else (above, place)
        yield _Candidate(V, origin, plant, T, level, LevelSet(V, level, T).size, beyond)


def _bisected(
    plant: DisturbedLoop, V: PolynomialFunction, T: np.ndarray, low: float
) -> tuple[float, float]:
    """Return the highest level at which the samples pass `_falls`, and a slightly higher level.

    The search is by bisection up to the next higher level of `_LEVELS`. The samples of the second
    level do not pass, unless this level is above all `_LEVELS`.

    low: a level at which the samples pass
    """
    above = low * float(_LEVELS[0] / _LEVELS[1])
    for _ in range(_FINER):
        middle = float(np.sqrt(low * above))
        if _falls(plant, V, T, middle)[0]:
            low = middle
        else:
            above = middle
    return low, above


def _falls(
    plant: DisturbedLoop, V: PolynomialFunction, T: np.ndarray, level: float
) -> tuple[bool, np.ndarray | None]:
    """Return whether V' < 0 and the limits hold at all samples of a level, and a state or None.

    The state is the sample with the largest V' if this V' is not negative, otherwise None.
    """
    points = edge_points(V, T, level) @ T.T
    if not len(points):
        return False, None
    with np.errstate(all="ignore"):
        rises = np.sum(V.slope(points) * plant.rates(points), axis=1)
    highest = int(np.argmax(rises))
    if not rises[highest] < 0.0:
        return False, points[highest]
    return not np.any(plant.away(points)), None


def _largest(loop: Loop, candidate: _Candidate, clock: Clock) -> ProvedLevel | None:
    """Return the proof of the largest level of a candidate, or None if no level is proved.

    The levels are fractions of the candidate's level. The fractions `_SHARES` are tried in order
    until one is proved. `_STEPS` bisections toward the next larger fraction follow.
    """
    n = len(candidate.T)
    degree = candidate.V.degree
    setting = next(tried for tried in settings_of(n, degree) if tried.degree >= degree)
    above = 1.0
    for share in _SHARES:
        proved = _at(loop, candidate, share, setting, clock)
        if proved is not None:
            break
        above = share
    else:
        return None
    low = share
    for _ in range(_STEPS):
        middle = (low + above) / 2
        more = _at(loop, candidate, middle, setting, clock)
        if more is None:
            above = middle
        else:
            low = middle
            proved = more
    return proved


def _at(
    loop: Loop, candidate: _Candidate, share: float, setting: Setting, clock: Clock
) -> ProvedLevel | None:
    """Return the proof of `share` times the level of a candidate, or None if there is no proof."""
    rho = share * candidate.level
    held = holding_ball(candidate.V, rho, candidate.T, clock)
    if held is None:
        return None
    try:
        return accepted(EdgeSearch(loop, candidate.V, rho, held, setting, clock))
    except NoSolutionError:  # not enclosed on such a large ball
        return None
