"""Size of the neighborhood of the trim in which a value agrees with simulated flights."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from controller.expansion.expansion import LOWEST, PERMITTED_ERROR, Expansion
from controller.expansion.series import directions, homogeneous, nominal_size
from hfa_aircraft.batch_simulation import (
    FAR_OF_EXPANSION,
    OF_EXPANSION,
    Cost,
    History,
    Rows,
    has_decayed,
    simulate_batch,
)
from hfa_support.matrices import quadratic_forms
from hfa_support.native.bound import RowFunction
from hfa_support.native.row_code import machine_code
from hfa_support.reporting.results import Result, Vector

#: Step times the magnitude of the fastest eigenvalue of the loop.
_STEP_OF_FASTEST = 0.2
#: A flight that has not ended after this many time constants of the slowest mode does not converge.
_TIME_CONSTANTS = 6.0
#: Number of steps between two tests of the end.
STEPS_PER_TEST = 10
#: Function of rows, with a list of one array of rows.
RateOfRows = Callable[[np.ndarray], list[np.ndarray]]


def scales_of_time(loop: np.ndarray) -> tuple[float, float]:
    """Return the step and the longest duration of flights about a stable loop z' = loop z, s.

    The fastest mode determines the step, and the slowest one the duration.
    """
    eigenvalues = np.linalg.eigvals(loop)
    step = _STEP_OF_FASTEST / np.abs(eigenvalues).max()
    return step, _TIME_CONSTANTS / -eigenvalues.real.max()


def flown_until_decayed(
    rates: RateOfRows, z0: np.ndarray, P: np.ndarray, step: float, ticks: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the last states and costs of flights, (N, n + 1), and whether z'Pz has decayed, (N,).

    rates: rows (N, n) of states -> rows (N, n + 1) of their rates and of the rate of the cost
    z0: initial states, (N, n)
    P: (n, n)
    step: step of the integration, s
    ticks: largest number of intervals of `STEPS_PER_TEST` steps
    """
    initial = quadratic_forms(z0, P)

    def over(flown: History) -> np.ndarray:
        """Return the mask (flights, steps) that is True at the last step of flights that are over.

        These are flights whose z'Pz has decayed, or has grown by `FAR_OF_EXPANSION`, at the end of
        an interval of `STEPS_PER_TEST` steps, which are the steps of `flown`.
        """
        z_now = flown.states[:, -1, :-1]  # without the cost
        value = quadratic_forms(z_now, P)
        at_start = initial[flown.flights]
        mask = np.zeros(flown.states.shape[:2], dtype=bool)
        is_far = ~(value <= FAR_OF_EXPANSION * at_start)  # true for a nan too
        mask[:, -1] = has_decayed(value, at_start, OF_EXPANSION) | is_far
        return mask

    starts = np.column_stack([z0, np.zeros(len(z0))])  # rows (z, cost)
    loop = Rows(lambda rows: rates(rows[:, :-1])[0], starts, step, STEPS_PER_TEST)
    with np.errstate(all="ignore"):
        flown, _ = simulate_batch(loop, ticks, over=over, keep=False)
        final = flown.states[:, 0]  # the only states that are kept
        return final, has_decayed(quadratic_forms(final[:, :-1], P), initial, OF_EXPANSION)


#: Number of random directions, of which those with the largest terms are flown.
_CANDIDATES = 2000
#: Number of directions with the largest terms of each degree, and of further random directions.
_DIRECTIONS_OF_TERM = 6
_RANDOM_DIRECTIONS = 8
#: Sizes that are flown, relative to that of nominal values, and those between two of them.
_SIZES = 2.0 ** np.arange(-20, 31)
_BETWEEN = 2.0 ** (np.arange(8) / 8)
#: Number and seed of the flights that confirm a radius. Further flights begin near the states with
#: the largest errors, at these distances.
_CONFIRMING_FLIGHTS = 200
_STATES_OF_LARGEST_ERRORS = 5
_STATES_NEAR_THEM = 55
_DISTANCES = (0.5, 0.25, 0.12)
_SEED = 2015
#: Factor of the size if a flight that confirms contradicts.
_REDUCTION = 0.95


@dataclass(frozen=True, eq=False)
class Radius(Result):
    """Largest set z'Pz <= c in which all sampled flights of both players agree with a value.

    degree: degree of the value, V2 + ... + V_degree
    share: largest difference from the cost of a flight, relative to the cost
    c: size of the set; 0 if flights of every size disagree, null if flights of every size agree
    extents: largest |z_i| in the set, (n,)
    """

    degree: int
    share: float
    c: float
    extents: Vector


def radii_of(expansion: Expansion) -> tuple[Radius, ...]:
    """Return the radius of V2 and that of the whole value, for errors up to `PERMITTED_ERROR`.

    All flights use the policies of the expansion. They begin at sizes √(z'Pz) that grow by the
    factor 2, in the directions of the largest terms and in random directions. The set ends before
    the first size at which a flight disagrees, and is confirmed by flights from 200 random states
    on its boundary, and from states ever closer to those with the largest errors.

    expansion: value and policies of both players
    """
    search = Search(expansion)
    return tuple(search.radius(degree) for degree in sorted({LOWEST, expansion.order}))


class Search:
    """Search for the radius of values of one expansion.

    States are given by y = root'z, so that z'Pz = |y|². Flights agree with a value if its errors
    are at most `PERMITTED_ERROR`.

    directions: unit vectors y, along which flights begin, (N, n)
    sizes: sizes √(z'Pz) that are flown first, (N,)
    """

    def __init__(self, expansion: Expansion) -> None:
        """Compile the flights, and choose their directions: random ones, and those of the largest
        terms.
        """
        game = expansion.game
        self.expansion = expansion
        z = ca.SX.sym("z", expansion.states)
        u, d = expansion.policy(z), expansion.disturbance(z)
        rates = expansion.rates(z, u) + ca.DM(game.E) @ d
        cost = Cost(game.Q, game.R, game.N).rate(z, u)
        if np.isfinite(game.delta):
            cost -= game.delta**2 * ca.dot(d, d)
        both = ca.densify(ca.vertcat(rates, cost))
        self._rates = RowFunction(machine_code(ca.Function("rates", [z], [both])))
        n = expansion.states
        drawn = directions(n, _CANDIDATES, _SEED)
        flown = [drawn[:_RANDOM_DIRECTIONS]]
        for degree, term in enumerate(expansion.value_terms[1:], LOWEST + 1):  # V3, V4, ...
            values = np.abs(homogeneous(n, degree).psi(drawn) @ term)
            flown.append(drawn[np.argsort(values)[-_DIRECTIONS_OF_TERM:]])
        # The opposite directions too, in which terms of an odd degree have the other sign.
        self.directions = np.vstack([*flown, *(-rays for rays in flown)])
        self.sizes = _SIZES * nominal_size(expansion.root, expansion.nominal)

    @cached_property
    def _errors_at_sizes(self) -> np.ndarray:
        return self.largest_errors(self.sizes)

    def largest_errors(self, sizes: np.ndarray) -> np.ndarray:
        """Return the largest difference from the cost of flights at each size, relative to it.

        The result has a row for each of V2, V2 + V3, ... up to the whole value, (D - 1, N) for the
        degree D, with inf where a flight does not converge.

        sizes: square roots of z'Pz, (N,)
        """
        y = (sizes[:, None, None] * self.directions).reshape(-1, self.expansion.states)
        return self._errors(y).reshape(-1, len(sizes), len(self.directions)).max(axis=2)

    def radius(self, degree: int) -> Radius:
        """Return the radius of V2 + ... + V_degree."""
        row = degree - LOWEST
        count = _agreeing(self._errors_at_sizes[row])
        size = [0.0, *self.sizes[:-1], math.inf][count]
        if 0.0 < size < math.inf:
            between = size * _BETWEEN
            size = between[_agreeing(self.largest_errors(between)[row]) - 1]
        while 0.0 < size < math.inf and not self._agrees_at_random(size, degree):
            size *= _REDUCTION
        z_of_y = np.linalg.inv(self.expansion.root.T)  # z'Pz = |y|²
        extents = size * np.linalg.norm(z_of_y, axis=1)  # largest |z_i| for |y| <= size
        return Radius(degree, share=PERMITTED_ERROR, c=size**2, extents=extents)

    def _errors(self, y: np.ndarray) -> np.ndarray:
        """Return the errors of V2, V2 + V3, ... for each flight from y, (D - 1, N): of its cost
        ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt, inf if it does not converge.
        """
        expansion, P = self.expansion, self.expansion.solution.P
        z = np.linalg.solve(expansion.root.T, y.T)  # z'Pz = |y|²
        step, longest = scales_of_time(expansion.game.worst_case_loop(P))
        ticks = (1 + int(longest / step)) // STEPS_PER_TEST
        final, ended = flown_until_decayed(self._rates, z.T, P, step, ticks)
        cost_to_go = np.array(expansion.V(final[:, :-1].T))[0]  # after the end
        costs = np.where(ended, final[:, -1] + cost_to_go, np.inf)
        terms = [
            homogeneous(len(P), degree).psi(y) @ term
            for degree, term in enumerate(expansion.value_terms, LOWEST)
        ]
        values = np.cumsum(terms, axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            errors = np.abs(values - costs) / np.abs(costs)
        return np.where((costs > 0.0) & np.isfinite(errors), errors, np.inf)

    def _agrees_at_random(self, size: float, degree: int) -> bool:
        """Return whether flights agree from random states of a size, and from ones near the worst.

        The worst are the states with the largest errors. Further states are drawn around them in
        several rounds, at smaller and smaller distances.
        """
        n = self.expansion.states
        unit_y = directions(n, _CONFIRMING_FLIGHTS, _SEED + degree)
        errors = self._errors(size * unit_y)[degree - LOWEST]
        for distance in _DISTANCES:
            if not np.all(errors <= PERMITTED_ERROR):
                break
            worst = unit_y[np.argsort(errors)[-_STATES_OF_LARGEST_ERRORS:]]
            random = directions(n, _STATES_NEAR_THEM, _SEED + degree)
            near = np.resize(worst, random.shape) + distance * random  # the worst, repeated
            unit_y = np.vstack([worst, near / np.linalg.norm(near, axis=1, keepdims=True)])
            errors = self._errors(size * unit_y)[degree - LOWEST]
        return bool(np.all(errors <= PERMITTED_ERROR))


def _agreeing(errors: np.ndarray) -> int:
    """Return the number of sizes before the first at which flights disagree."""
    return int(np.argmax(np.append(errors > PERMITTED_ERROR, True)))
