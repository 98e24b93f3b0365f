"""Obstacles to a set larger than a proved one: states with V' >= 0, and failing simulations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from hfa_aircraft.march.ending import FAR, FAR_OF_STARTS, EndRule, Outcome, is_at_rest
from hfa_aircraft.march.march import Rows, march
from hfa_prove.search.clock import Clock, OutOfTimeError
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.shape_boxes import Shape

#: Function of state deviations (N, n), with values (N,).
ValueOf = Callable[[np.ndarray], np.ndarray]
#: Bisections between the last sample without an obstacle and the first with one.
_HALVINGS = 12
#: Number of rays around which the next rays are drawn, and number of rays around each.
_NEAREST = 12
_AROUND = 30
#: Number of rays with simulated initial conditions.
_RAYS = 80
#: Number of initial conditions on each ray.
_SHELLS = 10
#: Distance of the farthest initial condition, over that of the set.
_FARTHEST = 20.0
#: Duration of these simulations, in time constants of the slowest mode.
_TIMES = 12.0
#: Simulation steps in the time constant of the fastest mode.
_STEPS = 3.0
#: Shares of the way to a state at which V is compared.
_WAY = np.arange(1, 21) / 20.0
#: Number of points on the edge of a set at which limits are compared.
_EDGE = 3000
#: A limit binds if a signal reaches this share of the distance to it.
_TOUCHES = 0.97


def rises(loop: LoopValues, slope: ValueOf) -> ValueOf:
    """Return the function z (N, n) -> mask (N,) of the points with V' >= 0 or undefined V'.

    slope: z (N, n) -> gradients (N, n) of V
    """

    def rising(z: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            falls = np.sum(slope(z) * loop.rates(z), axis=1) < 0.0
        return np.asarray(~falls)

    return rising


def first_obstacle(
    is_obstacle: ValueOf, V: ValueOf, T: np.ndarray, *, quick: bool = False
) -> tuple[float, np.ndarray | None]:
    """Return the lowest V found at an obstacle and the state deviation z (n,), or (inf, None).

    is_obstacle: state deviations (N, n) -> mask (N,) of the obstacles
    V: function of state deviations (N, n)
    T: matrix of the coordinates z = T y, (n, n), with samples in the unit ball of y
    quick: whether to use fewer samples
    """
    n = len(T)
    samples = 300 if quick else 2000
    turns = 6 if quick else 14
    radii = np.linspace(0.05, 1.0, 20 if quick else 40)
    generator = np.random.default_rng(0)
    directions = _unit(generator.normal(size=(samples, n)))
    best = np.inf
    place = None
    spread = 0.5
    for _ in range(turns):
        found = _along(is_obstacle, directions @ T.T, radii)
        values = np.where(np.isfinite(found), found, 1.0)
        points = (directions * values[:, None]) @ T.T
        levels = np.where(np.isfinite(found), V(points), np.inf)
        order = np.argsort(levels)[:_NEAREST]
        if levels[order[0]] < best:
            best = float(levels[order[0]])
            place = points[order[0]]
        if not np.isfinite(best):
            directions = _unit(generator.normal(size=(samples, n)))
            continue
        near = directions[order[np.isfinite(levels[order])]]
        tried = np.repeat(near, _AROUND, axis=0)
        directions = _unit(tried + spread * generator.normal(size=tried.shape) / np.sqrt(n))
        directions = np.concatenate([near, directions])
        spread *= 0.7
    return best, place


def _along(is_obstacle: ValueOf, rays: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return for each ray z (N, n) the lowest factor at which an obstacle is found, or inf, (N,).

    radii: increasing factors that are tried before the bisection
    """
    count, n = rays.shape
    points = (radii[:, None, None] * rays).reshape(-1, n)
    found_at = is_obstacle(points).reshape(len(radii), count)
    first = np.where(found_at.any(axis=0), found_at.argmax(axis=0), -1)
    found = np.full(count, np.inf)
    hit = first >= 0
    if not hit.any():
        return found
    high = radii[first[hit]]
    low = np.where(first[hit] > 0, radii[first[hit] - 1], 0.0)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        there = is_obstacle(middle[:, None] * rays[hit])
        high = np.where(there, middle, high)
        low = np.where(there, low, middle)
    found[hit] = high
    return found


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray(vectors / lengths)


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Obstacles to a set larger than the proved set.

    rises: lowest V found with V' >= 0 and the state deviation there, or (inf, None)
    starts: outcome -> lowest V of an initial condition with this outcome, and the initial condition
    limits: signals whose limits the set nearly reaches
    simulated: whether the simulations ended within the time limit
    """

    rises: tuple[float, np.ndarray | None]
    starts: Mapping[Outcome, tuple[float, np.ndarray]]
    limits: tuple[str, ...]
    simulated: bool = True


#: Descriptions of flights that do not enter the proved set.
NOT_RETURNED = {
    Outcome.LEFT: "flight leaves the limits",
    Outcome.DIVERGED: "flight does not converge",
    Outcome.UNDECIDED: "flight undecided within the time",
}


def obstacles_around(
    loop: LoopValues,
    proved: Shape,
    rise: tuple[float, np.ndarray | None],
    clock: Clock,
) -> Obstacles:
    """Return the obstacles around a proved set.

    Simulations begin on random rays from the equilibrium.

    rise: lowest V found with V' >= 0, and the state deviation there, or (inf, None)
    """
    generator = np.random.default_rng(1)
    rays = _unit(generator.normal(size=(_RAYS, proved.n))) @ proved.ball.T
    nearest = {}
    try:
        for outcome, starts in starts_by_outcome(loop, proved, rays, clock).items():
            # V of degree 4 or 6 may decrease again far outside the set
            values = np.max([proved.values(share * starts) for share in _WAY], axis=0)
            nearest[outcome] = (float(values.min()), starts[values.argmin()])
        simulated = True
    except OutOfTimeError:
        simulated = False
    edge = proved.edge_points(_EDGE) @ proved.N.T
    limits = []
    for name, (values, low, high) in loop.limited_signals(edge).items():
        if values.min() <= _TOUCHES * low or values.max() >= _TOUCHES * high:
            limits.append(name)
    return Obstacles(rise, nearest, tuple(limits), simulated)


def starts_by_outcome(
    loop: LoopValues, proved: Shape, rays: np.ndarray, clock: Clock
) -> dict[Outcome, np.ndarray]:
    """Return outcome -> initial conditions (k, n) from which simulations have this outcome.

    - `LEFT`, `DIVERGED`: approximately the first initial condition with this outcome on each ray.
      Another equilibrium (`ELSEWHERE`) counts as `DIVERGED`
    - `UNDECIDED`: every simulated initial condition without an outcome in the time limit

    rays: rays from the equilibrium with ends near the boundary of the set, (N, n)

    Raises OutOfTimeError at the time limit of the clock.
    """
    rates = np.linalg.eigvals(loop.J).real
    seconds = _TIMES / float(np.min(np.abs(rates)))
    low = np.minimum(proved.edges(rays @ proved.M.T), 1.0)
    high = low * _FARTHEST
    kinds = np.zeros(0, dtype=object)
    open_starts = np.zeros((0, rays.shape[1]))
    for _ in range(2):
        shells = low + (high - low) * np.linspace(0.0, 1.0, _SHELLS + 1)[1:, None] ** 2
        starts = (shells[:, :, None] * rays).reshape(-1, rays.shape[1])
        found = outcomes(loop, starts, proved.contains, seconds, clock)
        open_starts = np.concatenate([open_starts, starts[found == Outcome.UNDECIDED]])
        found[found == Outcome.ELSEWHERE] = Outcome.DIVERGED
        found = found.reshape(shells.shape)
        gone = (found == Outcome.LEFT) | (found == Outcome.DIVERGED)
        kinds = found[gone.argmax(axis=0), np.arange(len(rays))][gone.any(axis=0)]
        rays, low, high = _first_not_converging(rays, low, shells, gone)
        if not len(rays):
            break
    first = np.asarray(high[:, None] * rays)
    of_kind = {kind: first[kinds == kind] for kind in (Outcome.LEFT, Outcome.DIVERGED)}
    of_kind[Outcome.UNDECIDED] = open_starts
    return {kind: starts for kind, starts in of_kind.items() if len(starts)}


def _first_not_converging(
    rays: np.ndarray, low: np.ndarray, shells: np.ndarray, gone: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rays with a factor that fails to converge, and two factors for each of these rays.

    The second factor is the first that fails to converge. The first factor is the factor on the
    next lower shell, or `low` if the second factor is on the first shell. A factor times a ray is
    an initial condition.

    rays: (N, n)
    low: factors that converge, (N,)
    shells: increasing factors, (k, N)
    gone: mask of the factors that fail to converge, (k, N)
    """
    hit = gone.any(axis=0)
    first = gone.argmax(axis=0)[hit]
    columns = np.flatnonzero(hit)
    before = np.vstack([low, shells])[first, columns]
    return rays[hit], before, shells[first, columns]


def outcomes(
    loop: LoopValues,
    starts: np.ndarray,
    holds: Callable[[np.ndarray], np.ndarray],
    seconds: float,
    clock: Clock,
) -> np.ndarray:
    """Return the `Outcome` of a simulation from each initial condition, (N,).

    Outcomes are tested at every step of the classical Runge-Kutta method. A trajectory diverges if
    a state is not finite, or exceeds both `FAR` nominal values and `FAR_OF_STARTS` times the
    largest initial deviation. A trajectory that is nearly at rest after `seconds` has converged to
    another equilibrium.

    starts: initial deviations from the equilibrium, (N, n)
    holds: deviations (N, n) -> mask (N,) of those in the proved set
    seconds: longest duration of each simulation, s

    Raises OutOfTimeError at the time limit of the clock.
    """
    largest = np.max(np.abs(starts), axis=0, initial=0.0)
    far = np.maximum(FAR * loop.nominal, FAR_OF_STARTS * largest)
    fastest = float(np.max(np.abs(np.linalg.eigvals(loop.J))))
    step = 1.0 / (_STEPS * fastest)
    rule = EndRule(far, lambda z: ~loop.beyond(z), holds)

    def no_inputs(z: np.ndarray, _: np.ndarray) -> np.ndarray:
        clock(0.0, 1.0, "flights around the set")
        return z[:, :0]

    flights = Rows(lambda z, _: loop.rates(z), starts, step, no_inputs)
    ticks = int(np.ceil(seconds / step)) + 1
    with np.errstate(all="ignore"):  # diverging states overflow
        flown, _ = march(flights, ticks, over=rule.over, keep=False)
        final = flown.states[:, 0]
        result = rule.outcomes(final)
        rests = is_at_rest(loop.rates(final), seconds, loop.nominal)
    result[rests & (result == Outcome.UNDECIDED)] = Outcome.ELSEWHERE
    return result
