"""Size of the neighbourhood of the trim in which a value agrees with simulated flights."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from controller.expansion.expansion import SHARE, Expansion
from controller.expansion.flights import Flights
from controller.expansion.monomials import homogeneous, monomial_scales
from controller.expansion.series import directions
from controller.game.basis import TO_DEGREE
from hfa_support.reporting.results import Result, Vector

#: Degree of the value of the linear game.
_QUADRATIC = min(TO_DEGREE)
#: Number of random directions, from which those with the largest terms are flown.
_DRAWN = 2000
#: Number of directions with the largest terms of each degree, and of further random directions.
_LARGEST = 6
_RANDOM = 8
#: Number and seed of the flights that confirm a radius. Further flights begin near the states with
#: the largest errors, at these distances.
_CONFIRMING = 200
_WORST = 5
_NEAR = 55
_DISTANCES = (0.5, 0.25, 0.12)
_SEED = 2015
#: Ratio of two sizes between which the search stops, and the factor if a flight contradicts.
_FINE = 1.1
_SMALLER = 0.95
#: Largest ratio of the found size to the first one, and its inverse.
_FARTHEST = 2.0**30


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
    """Return the radius of V2 and that of the whole value, with differences of at most `SHARE`.

    All flights use the policies of the expansion. For each value, the set is found by bisection
    with flights from its boundary in the directions of the largest terms and in random directions,
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
    """Search for the radius of values of one expansion."""

    def __init__(self, expansion: Expansion) -> None:
        """Choose the directions of the flights: random ones, and those of the largest terms."""
        self.expansion = expansion
        self.flights = Flights(expansion)
        n = expansion.states
        drawn = directions(n, _DRAWN, _SEED)
        flown = [drawn[:_RANDOM]]
        self._largest_terms: dict[int, float] = {}  # degree -> largest |V_d| on z'Pz = 1
        for degree, term in enumerate(expansion.value_terms[1:], _QUADRATIC + 1):
            values = np.abs(homogeneous(n, degree).psi(drawn) @ (monomial_scales(n, degree) * term))
            self._largest_terms[degree] = float(values.max())
            flown.append(drawn[np.argsort(values)[-_LARGEST:]])
        self.directions = np.vstack([*flown, *(-each for each in flown)])

    def radius(self, degree: int) -> Radius:
        """Return the radius of V2 + ... + V_degree.

        The size √(z'Pz) is found by flights along fixed directions, and reduced until random states
        of this size agree too.
        """
        size = self._largest_agreeing(degree)
        while 0.0 < size < math.inf and not self._agrees_at_random(size, degree):
            size *= _SMALLER
        z_of_y = np.linalg.inv(self.expansion.root.T)  # z'Pz = |y|²
        largest_z = size * np.linalg.norm(z_of_y, axis=1)
        return Radius(degree, SHARE, size**2, largest_z)

    def _largest_agreeing(self, degree: int) -> float:
        """Return the largest size whose flights agree, 0 or inf if there is none."""
        first = self._guess(degree)
        agreeing = disagreeing = first
        while self._agrees(self.directions * disagreeing, degree):
            agreeing, disagreeing = disagreeing, 2.0 * disagreeing
            if disagreeing > first * _FARTHEST:
                return math.inf
        while not self._agrees(self.directions * agreeing, degree):
            agreeing, disagreeing = agreeing / 2.0, agreeing
            if agreeing < first / _FARTHEST:
                return 0.0
        while disagreeing > agreeing * _FINE:
            middle = math.sqrt(agreeing * disagreeing)
            if self._agrees(self.directions * middle, degree):
                agreeing = middle
            else:
                disagreeing = middle
        return agreeing

    def _guess(self, degree: int) -> float:
        """Return the size s at which the next term has the permitted share of V2.

        The term of degree d is at most largest[d] s^(d-2) V2. Without a further known term, the
        last known one counts; without any, s is 1.
        """
        nonzero = {d: largest for d, largest in self._largest_terms.items() if largest > 0.0}
        if not nonzero:
            return 1.0
        d = min((d for d in nonzero if d > degree), default=max(nonzero))
        return (SHARE / nonzero[d]) ** (1.0 / (d - 2))

    def _agrees(self, y: np.ndarray, degree: int) -> bool:
        """Return whether the value differs from the cost by at most `SHARE` on all flights.

        y: (N, n), initial states, z'Pz = |y|²
        """
        return bool(np.all(self._errors(y, degree) <= SHARE))

    def _errors(self, y: np.ndarray, degree: int) -> np.ndarray:
        """Return the difference of the value from the cost of flights, relative to the cost, (N,).

        A flight that does not converge has the error inf.

        y: (N, n), initial states, z'Pz = |y|²
        """
        z = np.linalg.solve(self.expansion.root.T, y.T).T
        costs = self.flights.costs(z)
        values = np.array(self.expansion.value_to(degree)(z.T))[0]
        return _relative_errors(values, costs)

    def _agrees_at_random(self, size: float, degree: int) -> bool:
        """Return whether flights from random states of a size agree, and from ever worse ones.

        Worse ones are states of this size ever closer to those with the largest errors.
        """
        n = self.expansion.states
        unit_y = directions(n, _CONFIRMING, _SEED + degree)
        errors = self._errors(size * unit_y, degree)
        for distance in _DISTANCES:
            if not np.all(errors <= SHARE):
                return False
            worst = unit_y[np.argsort(errors)[-_WORST:]]
            random = directions(n, _NEAR, _SEED + degree)
            near = np.resize(worst, random.shape) + distance * random
            unit_y = np.vstack([worst, near / np.linalg.norm(near, axis=1, keepdims=True)])
            errors = self._errors(size * unit_y, degree)
        return bool(np.all(errors <= SHARE))
