"""Size of the neighborhood of the trim in which a value agrees with simulated flights."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from controller.expansion.expansion import PERMITTED_ERROR, Expansion
from controller.expansion.series import directions, homogeneous, nominal_size
from controller.game.basis import TO_DEGREE
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


class Flights:
    """Simulated flights z' = F(z, u) + E d of both players of an expansion, by Runge-Kutta steps.

    The cost ∫ z'Qz + 2z'Nu + u'Ru - δ² d'd dt is integrated with the state.

    step: step of the integration, s; the relative error of a cost is about 1e-4
    longest: time after which a flight that still lasts does not converge, s
    """

    def __init__(self, expansion: Expansion) -> None:
        """Compile the rates of the state and of the cost, and choose the step.

        expansion: value and policies of both players
        """
        game = expansion.game
        self.expansion = expansion
        self.step, self.longest = scales_of_time(game.worst_case_loop(expansion.solution.P))
        z = ca.SX.sym("z", expansion.states)
        u = expansion.policy(z)
        rates = expansion.rates(z, u)
        cost = Cost(game.Q, game.R, game.N).rate(z, u)
        if np.isfinite(game.delta):
            d = expansion.disturbance(z)
            rates += ca.DM(game.E) @ d
            cost -= game.delta**2 * ca.dot(d, d)
        both = ca.densify(ca.vertcat(rates, cost))
        self._rates = RowFunction(machine_code(ca.Function("rates", [z], [both])))
        self._V = RowFunction(expansion.V)

    def costs(self, z0: np.ndarray) -> np.ndarray:
        """Return the cost of the flights from N initial states, (N,), inf if one does not converge.

        z0: (N, n), initial deviations from the trim
        """
        ticks = (1 + int(self.longest / self.step)) // STEPS_PER_TEST
        P = self.expansion.solution.P
        final, ended = flown_until_decayed(self._rates, z0, P, self.step, ticks)
        costs = np.full(len(z0), np.inf)
        if ended.any():
            z_end, cost_to_end = final[ended, :-1], final[ended, -1]
            (V_end,) = self._V(z_end)  # the cost after the end, (N, 1)
            costs[ended] = cost_to_end + V_end[:, 0]
        return costs


def scales_of_time(loop: np.ndarray) -> tuple[float, float]:
    """Return the step and the longest duration of flights about a stable loop z' = loop z, s.

    The fastest mode determines the step, and the slowest one the duration.
    """
    eigenvalues = np.linalg.eigvals(loop)
    step = _STEP_OF_FASTEST / float(np.abs(eigenvalues).max())
    return step, _TIME_CONSTANTS / float(-eigenvalues.real.max())


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


#: Degree of the value of the linear game.
_QUADRATIC = min(TO_DEGREE)
#: Number of random directions, of which those with the largest terms are flown.
_CANDIDATES = 2000
#: Number of directions with the largest terms of each degree, and of further random directions.
_DIRECTIONS_OF_TERM = 6
_RANDOM_DIRECTIONS = 8
#: Number and seed of the flights that confirm a radius. Further flights begin near the states with
#: the largest errors, at these distances.
_CONFIRMING_FLIGHTS = 200
_STATES_OF_LARGEST_ERRORS = 5
_STATES_NEAR_THEM = 55
_DISTANCES = (0.5, 0.25, 0.12)
_SEED = 2015
#: Ratio of two sizes between which the search stops, and the factor if a flight contradicts.
_RATIO_AT_END = 1.1
_REDUCTION = 0.95
#: Size, relative to that of nominal values, from which flights need not be flown inward.
_SMALLEST = 0.01
#: Largest ratio of the found size to the first one, and its inverse.
_LARGEST_RATIO = 2.0**30


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

    All flights use the policies of the expansion. For each value, the set is found by bisection
    with flights from its boundary in the directions of the largest terms and in random directions,
    and from sets inside it, at each of which those of the next larger one end,
    and then confirmed by flights from 200 random states on its boundary, and from states ever
    closer to those with the largest errors.

    expansion: value and policies of both players
    """
    search = _Search(expansion)
    degrees = sorted({_QUADRATIC, expansion.order})
    return tuple(search.radius(degree) for degree in degrees)


def largest_errors(expansion: Expansion, sizes: np.ndarray) -> np.ndarray:
    """Return the largest difference from the cost of flights at each size, relative to the cost.

    The result has a row for each of V2, V2 + V3, ... up to the whole value, (D - 1, N) for
    the degree D, with inf where a flight does not converge. The flights are those of the search for
    the radius.

    expansion: value and policies of both players
    sizes: square roots of z'Pz, (N,)
    """
    search = _Search(expansion)
    y = (sizes[:, None, None] * search.directions).reshape(-1, expansion.states)
    z = np.linalg.solve(expansion.root.T, y.T).T  # z'Pz = |y|², P = root root'
    costs = search.flights.costs(z)
    rows = []
    for degree in range(_QUADRATIC, expansion.order + 1):
        values = np.array(expansion.value_to(degree)(z.T))[0]
        errors = _relative_errors(values, costs).reshape(len(sizes), -1)
        rows.append(errors.max(axis=1))
    return np.array(rows)


def _relative_errors(values: np.ndarray, costs: np.ndarray) -> np.ndarray:
    """Return |value - cost| / |cost|, (N,), inf unless the cost is positive and finite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.abs(values - costs) / np.abs(costs)
    return np.where((costs > 0.0) & np.isfinite(errors), errors, np.inf)


class _Search:
    """Search for the radius of values of one expansion.

    States are given by y = root'z, so that z'Pz = |y|². Flights agree with a value if its errors
    are at most `PERMITTED_ERROR`.

    flights: simulated costs of both players
    directions: unit vectors y, along which flights begin, (N, n)
    """

    def __init__(self, expansion: Expansion) -> None:
        """Choose the directions of the flights: random ones, and those of the largest terms."""
        self.expansion = expansion
        self.flights = Flights(expansion)
        n = expansion.states
        drawn = directions(n, _CANDIDATES, _SEED)
        flown = [drawn[:_RANDOM_DIRECTIONS]]
        self._nominal = nominal_size(expansion.root, expansion.nominal)
        self._largest_terms: dict[int, float] = {}  # degree -> largest |V_d| on z'Pz = 1
        for degree, term in enumerate(expansion.value_terms[1:], _QUADRATIC + 1):  # V3, V4, ...
            values = np.abs(homogeneous(n, degree).psi(drawn) @ term)
            self._largest_terms[degree] = float(values.max())
            flown.append(drawn[np.argsort(values)[-_DIRECTIONS_OF_TERM:]])
        # The opposite directions too, in which terms of an odd degree have the other sign.
        self.directions = np.vstack([*flown, *(-rays for rays in flown)])

    def radius(self, degree: int) -> Radius:
        """Return the radius of V2 + ... + V_degree.

        The size √(z'Pz) is found by flights along fixed directions, and reduced until random states
        of this size agree too.
        """
        size = self._largest_agreeing(degree)
        while 0.0 < size < math.inf and not self._agrees_at_random(size, degree):
            size *= _REDUCTION
        z_of_y = np.linalg.inv(self.expansion.root.T)  # z'Pz = |y|²
        extents = size * np.linalg.norm(z_of_y, axis=1)  # largest |z_i| for |y| <= size
        return Radius(degree, share=PERMITTED_ERROR, c=size**2, extents=extents)

    def _largest_agreeing(self, degree: int) -> float:
        """Return the largest size s = √(z'Pz) whose flights agree, 0 if none do, inf if all do.

        The size is doubled while flights agree, or halved until they do, and then bisected.
        """
        size = first = min(self._guess(degree), self._nominal)
        first_agrees = self._agrees(first, degree)
        factor = 2.0 if first_agrees else 0.5
        while self._agrees(size * factor, degree) == first_agrees:
            size *= factor
            if not first / _LARGEST_RATIO < size < first * _LARGEST_RATIO:
                return math.inf if first_agrees else 0.0
        agreeing, disagreeing = sorted((size, size * factor))
        while disagreeing > agreeing * _RATIO_AT_END:
            middle = math.sqrt(agreeing * disagreeing)
            if self._agrees(middle, degree):
                agreeing = middle
            else:
                disagreeing = middle
        return agreeing

    def _guess(self, degree: int) -> float:
        """Return the size s = √(z'Pz) at which the next term of V has the permitted share of V2.

        V2 is s², and the term of degree d is at most largest s^d. The error of the whole V, which
        has no next term, is guessed from its last term.
        """
        nonzero = {d: largest for d, largest in self._largest_terms.items() if largest > 0.0}
        if not nonzero:
            return math.inf
        d = min((d for d in nonzero if d > degree), default=max(nonzero))
        return (PERMITTED_ERROR / nonzero[d]) ** (1.0 / (d - 2))

    def _agrees(self, size: float, degree: int) -> bool:
        """Return whether all flights from states of a size, along the directions, agree, and from
        smaller ones, which those from the size end at.
        """
        sizes = self._inward(size)
        y = (sizes[:, None, None] * self.directions).reshape(-1, self.expansion.states)
        return bool(np.all(self._errors(y, degree) <= PERMITTED_ERROR))

    def _inward(self, size: float) -> np.ndarray:
        """Return sizes from a size inward, each of which flights from the one before end at."""
        smallest = min(size, _SMALLEST * self._nominal)
        count = 1 + math.ceil(math.log(smallest / size) / (0.5 * math.log(OF_EXPANSION)))
        return size * OF_EXPANSION ** (0.5 * np.arange(count))

    def _errors(self, y: np.ndarray, degree: int) -> np.ndarray:
        """Return the error of the value for each flight from y, (N,), inf if it diverges."""
        z = np.linalg.solve(self.expansion.root.T, y.T).T  # z'Pz = |y|²
        costs = self.flights.costs(z)
        values = np.array(self.expansion.value_to(degree)(z.T))[0]
        return _relative_errors(values, costs)

    def _agrees_at_random(self, size: float, degree: int) -> bool:
        """Return whether flights agree from random states of a size, and from ones near the worst.

        The worst are the states with the largest errors. Further states are drawn around them in
        several rounds, at smaller and smaller distances.
        """
        n = self.expansion.states
        unit_y = directions(n, _CONFIRMING_FLIGHTS, _SEED + degree)
        errors = self._errors(size * unit_y, degree)
        for distance in _DISTANCES:
            if not np.all(errors <= PERMITTED_ERROR):
                return False
            worst = unit_y[np.argsort(errors)[-_STATES_OF_LARGEST_ERRORS:]]
            random = directions(n, _STATES_NEAR_THEM, _SEED + degree)
            near = np.resize(worst, random.shape) + distance * random  # the worst, repeated
            unit_y = np.vstack([worst, near / np.linalg.norm(near, axis=1, keepdims=True)])
            errors = self._errors(size * unit_y, degree)
        return bool(np.all(errors <= PERMITTED_ERROR))
