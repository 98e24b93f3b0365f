"""Linear programs for polynomials W that satisfy the inequality of the bound at samples.

W = s (1 - margin) z'P z plus terms of higher degree, with s <= 1. W is as large as the inequality
grad W · f + z'Q z + v'R v >= 0 permits at the samples. A part of the margin is kept in reserve.
The minimizing inputs at a sample depend on W. Constraints with the minimizing inputs of the present
W are therefore added until no constraint is violated (cutting planes).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from hfa_aircraft.march.cost import Cost
from hfa_prove.check.cover import OpenBoxError
from hfa_prove.check.equilibrium import Equilibrium
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search.clock import Clock
from hfa_prove.search.flights import Inputs, flight_costs
from hfa_prove.search.obstacles import first_obstacle
from hfa_prove.statements.piece import Piece, Polynomial
from hfa_prove.statements.plant import Plant

#: Half-width of the cube of a quadratic W relative to its set. Above 2, the boxes at the faces
#: after one halving are outside the set.
_ROOM = 2.05
#: Share of the margin that the rows of the linear programs keep.
_KEPT = 0.6
#: Number of samples in a turn.
_SAMPLES = 20_000
#: Largest number of rows that a turn adds.
_ADDED = 400
#: Largest number of turns of one fit.
_TURNS = 40
#: Number of samples in the first linear program.
_FIRST = 1500
#: Largest W of the samples in a turn, relative to the level.
_NEAR_SET = 1.05
#: A row is violated if its slack, divided by the running cost, is below minus this share of the
#: margin. A slack of -_KEPT margins means g = 0.
_VIOLATED = 0.1
#: Largest number of rows of a linear program.
_MOST_ROWS = 6000
#: Number of rows that are kept when there are more, those of least slack.
_KEPT_ROWS = 4000
#: Lowest factor s of the quadratic part.
_LEAST_SQUARE = 0.01
#: Number of samples over which the functions are orthonormal.
_ORTHONORMAL = 8000
#: Largest coefficient of these functions, relative to the level.
_LARGEST = 1000.0


@dataclass(frozen=True, eq=False)
class CostProblem:
    """Linear quadratic problem whose cost is to be bounded from below.

    plant: the aircraft, whose state limits are the envelope
    equilibrium: enclosure of the equilibrium states and inputs
    Q: weight of the states, (n, n)
    R: weight of the inputs, (m, m)
    P: matrix of the optimal linear quadratic cost z'P z, (n, n)
    degree: degree of W
    margin: relative distance of W below the cost
    """

    plant: Plant
    equilibrium: Equilibrium
    Q: np.ndarray
    R: np.ndarray
    P: np.ndarray
    degree: int
    margin: float

    @cached_property
    def inputs(self) -> Inputs:
        """Minimizer of the Hamiltonian over the inputs."""
        return Inputs(self.plant, self.equilibrium, self.R)

    def linear_cost(self, z: np.ndarray) -> np.ndarray:
        """Return the linear quadratic cost z'P z (N,) at state deviations z (N, n)."""
        return np.asarray(np.einsum("ki,ij,kj->k", z, self.P, z))

    def in_envelope(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of the state deviations z (N, n) within the state limits."""
        low, high = self.plant.ends(self.plant.states).T
        x = z + self.equilibrium.x[: z.shape[1]]
        return np.asarray(np.all((low <= x) & (x <= high), axis=1))

    def permitted_level(self, share: float, largest: float) -> float:
        """Return the lowest level of W = share z'P z at which samples violate the inequality.

        The samples are within the envelope, with z'P z up to `largest`. The result is inf if no
        sample violates the inequality.
        """

        def violated(z: np.ndarray) -> np.ndarray:
            gradient = 2.0 * share * z @ self.P
            v = self.inputs.best(z, gradient)
            rise = np.sum(gradient * self.inputs.rates(z, v), axis=1)
            return np.asarray(
                self.in_envelope(z) & ~(rise + Cost(self.Q, self.R).rate(z, v) >= 0.0)
            )

        T = np.sqrt(largest) * np.linalg.inv(np.linalg.cholesky(self.P)).T
        with np.errstate(all="ignore"):
            return share * first_obstacle(violated, self.linear_cost, T, quick=True)[0]

    def coordinates(self, share: float, z: np.ndarray) -> np.ndarray:
        """Return M (n, n) of coordinates y = M z in which z'P z and the least of g are diagonal.

        The least of g over the inputs is that of W = share z'P z, to second order. The largest
        |y_i| of the state deviations z (N, n), and of the ends of the axes of the smallest ball
        of z'P z that contains them, is 1.
        """
        n = len(self.P)
        L = np.linalg.cholesky(self.P)
        G = self.P @ self.inputs.linear()[:, n:]
        price = self.Q + share * G @ np.linalg.pinv(self.R) @ G.T
        inner = np.linalg.solve(L, np.linalg.solve(L, price).T)
        turn = np.linalg.eigh(0.5 * (inner + inner.T))[1]
        # ends of the axes of the ball, in z, which random samples do not reach in many dimensions
        axes = np.sqrt(np.max(self.linear_cost(z))) * np.linalg.solve(L.T, turn).T
        samples = np.concatenate([z, axes[self.in_envelope(axes)]])
        return np.asarray((L @ turn / np.abs(samples @ L @ turn).max(axis=0)).T)

    def ball(self, count: int, largest: float, random: np.random.Generator) -> np.ndarray:
        """Return random state deviations z (count, n) with z'P z <= largest within the envelope.

        The samples are denser near 0 than uniform samples. Fewer samples are returned if the
        envelope contains only a small part of the ellipsoid.
        """
        n = len(self.P)
        L = np.linalg.cholesky(self.P)
        found = np.zeros((0, n))
        for _ in range(200):
            rays = random.normal(size=(4 * count, n))
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            radii = random.uniform(size=(len(rays), 1)) ** (1.5 / n)
            z = np.sqrt(largest) * np.linalg.solve(L.T, (radii * rays).T).T
            found = np.concatenate([found, z[self.in_envelope(z)]])
            if len(found) >= count:
                break
        return found[:count]

    def saturated_lqr_costs(self, z: np.ndarray, clock: Clock) -> np.ndarray:
        """Return the costs (N,) of flights from state deviations z (N, n) with the saturated LQR.

        The cost is inf for a flight that leaves the envelope or does not converge.

        Raises OutOfTimeError at the time limit.
        """
        return flight_costs(
            self.inputs,
            (self.Q, self.R, self.P),
            lambda z: np.asarray(2.0 * z @ self.P),
            self.in_envelope,
            z,
            clock,
        )


def quadratic_piece(problem: CostProblem, share: float, c: float) -> Piece:
    """Return the piece W = share z'P z of level c.

    The boxes at the faces of its cube are outside the set after one halving.
    """
    z = problem.ball(_SAMPLES, c / share, np.random.default_rng(1))
    M = problem.coordinates(share, z) / _ROOM
    N = np.linalg.inv(M)
    return Piece(M, PolynomialFunction.quadratic(share * N.T @ problem.P @ N).rounded(), c)


class TargetFlights(NamedTuple):
    """Flights at which W is to be large, but at most their cost.

    z: initial conditions, (N, n)
    costs: costs of the flights, (N,)
    of_least: weight of the lowest ratio of W to a cost, relative to the weight of the mean ratios
    """

    z: np.ndarray
    costs: np.ndarray
    of_least: float


class Fit:
    """Linear programs for the polynomial W of one level, in coordinates y = M z.

    The samples are within the envelope and z'P z <= beyond c. They lie in the cube |y_i| < 1.

    problem: linear quadratic problem whose cost is bounded
    c: level
    wanted: flights at which W is to be large
    beyond: largest z'P z of samples, relative to c. Further out, W > c is required.
    report: called with the number of programs before each linear program. The callback may raise.
    """

    def __init__(
        self,
        problem: CostProblem,
        c: float,
        wanted: TargetFlights,
        beyond: float,
        report: Callable[[int], None],
    ) -> None:
        self._problem = problem
        self.c = c
        self._wanted = wanted
        self._beyond = beyond
        self._report = report
        self._random = np.random.default_rng(1)
        self.M = problem.coordinates(1.0 - problem.margin, self._ball(4000)) / 1.02
        self.N = np.linalg.inv(self.M)
        square = (1.0 - problem.margin) * self.N.T @ problem.P @ self.N
        #: W of the last linear program. The quadratic part remains that of the first W.
        self._W = self._first = PolynomialFunction.quadratic(square, problem.degree)
        self._orthonormal = self._combinations()
        self._rows: list[np.ndarray] = []
        self._sides: list[np.ndarray] = []
        self._begun = False

    def fitted(self) -> Polynomial:
        """Return the polynomial W of the last linear program.

        At most `_TURNS` programs are solved. Each program includes the constraints that the
        previous W violates at new samples.

        Raises OpenBoxError if a program has no solution.
        """
        if not self._rows:
            z = self._ball(_FIRST)
            self._add(z, self._best_inputs(z))
            self._add_outer_constraints(_FIRST, every=True)
        for _ in range(_TURNS):
            self._report(len(self._sides))
            self._solve()
            rows, sides = self._violated()
            has_low_wall = self._add_outer_constraints(_FIRST // 3, every=False)
            if not len(rows) and not has_low_wall:
                break
            self._rows.append(rows)
            self._sides.append(sides)
        return self._W.rounded()

    def _violated(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the constraints that W violates most at new samples.

        A constraint is a row of coefficients and a right side. The arrays have the shapes (k, K)
        and (k,).
        """
        z = self._ball(_SAMPLES)
        z = z[self._W(z @ self.M.T) <= _NEAR_SET * self.c]
        rows, sides = self._row(z, self._best_inputs(z))
        slack = rows @ self._W.coefficients - sides
        worst = np.argsort(slack)[:_ADDED]
        worst = worst[slack[worst] < -_VIOLATED * self._problem.margin]
        return rows[worst], sides[worst]

    def refuted(self, y: np.ndarray) -> None:
        """Add constraints at and near a point y (n,) at which a proof of W failed.

        On a face of the cube the constraints are W >= 1.02 c, elsewhere g >= 0.
        """
        on_face = np.abs(y) == 1.0
        if np.any(on_face):
            near = np.clip(y + 0.05 * self._random.normal(size=(30, len(y))), -1.0, 1.0)
            self._add_high(np.concatenate([y[None], np.where(on_face, y, near)]))
            return
        near = y + 0.02 * self._random.normal(size=(30, len(y)))
        z = np.concatenate([y[None], near]) @ self.N.T
        self._add(z, self._best_inputs(z))

    def _ball(self, count: int) -> np.ndarray:
        """Return random z (count, n) with z'P z <= beyond c within the envelope."""
        return self._problem.ball(count, self._beyond * self.c, self._random)

    def _combinations(self) -> np.ndarray:
        """Return combinations (K, k) of the monomials of degree 3 and more, as columns.

        The combinations are orthonormal over samples. The linear programs are therefore well
        conditioned.
        """
        higher = self._W.degrees > 2
        values = self._W.monomials(self._ball(_ORTHONORMAL) @ self.M.T)[:, higher]
        found = np.zeros((len(higher), int(higher.sum())))
        found[higher] = np.linalg.inv(np.linalg.qr(values)[1]) * np.sqrt(len(values))
        return found

    def _solve(self) -> None:
        """Compute the coefficients of W by a linear program.

        W maximizes the sum of three terms:
        - the mean over samples of W / z'P z
        - the mean of W / cost at the wanted flights
        - the weighted lowest ratio of W to the cost of a wanted flight

        Raises OpenBoxError if the program has no solution.
        """
        rows = np.concatenate(self._rows)
        sides = np.concatenate(self._sides)
        y = self._ball(4000) @ self.M.T
        if self._begun:
            y = y[self._W(y) <= self.c]
        linear = self._problem.linear_cost(y @ self.N.T)
        gain = np.mean(self._W.monomials(y) / linear[:, None], axis=0)
        wanted = self._W.monomials(self._wanted.z @ self.M.T) / self._wanted.costs[:, None]
        if len(wanted):
            gain += np.mean(wanted, axis=0)
        unknowns = np.column_stack([self.c * self._orthonormal, self._first.coefficients])
        free = unknowns.shape[1] - 1
        every = np.concatenate([rows, wanted]) @ unknowns
        of_t = np.concatenate([np.zeros(len(rows)), np.ones(len(wanted))])
        left = np.concatenate([sides, np.zeros(len(wanted))])
        found = linprog(
            -np.append(gain @ unknowns, self._wanted.of_least),
            np.column_stack([-every, of_t]),
            -left,
            bounds=[(-_LARGEST, _LARGEST)] * free + [(_LEAST_SQUARE, 1.0), (None, 1.0)],
            method="highs",
        )
        if found.x is None:
            raise OpenBoxError(
                f"no polynomial of degree {self._problem.degree} satisfies the inequality at the "
                "sample points",
                y[0],
            )
        self._W = self._W.with_coefficients(unknowns @ found.x[:-1])
        slack = rows @ self._W.coefficients - sides
        if len(rows) > _MOST_ROWS:
            kept = np.argsort(slack)[:_KEPT_ROWS]
            self._rows = [rows[kept]]
            self._sides = [sides[kept]]
        self._begun = True

    def _row(self, z: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (N, K) and right sides (N,) of the inequality at samples.

        The inequality is grad W · f + (1 - kept margin) (z'Q z + v'R v) >= 0, divided by the
        running cost. The kept margin is `_KEPT` times the margin of the problem.

        z: state deviations, (N, n)
        v: input deviations, (N, m)
        """
        problem = self._problem
        f = problem.inputs.rates(z, v) @ self.M.T
        rows = np.einsum("ktj,kj->kt", self._W.monomial_slopes(z @ self.M.T), f)
        scale = Cost(problem.Q, problem.R).rate(z, v) + 1e-12 * self.c
        return rows / scale[:, None], np.full(len(z), -(1.0 - _KEPT * problem.margin))

    def _add(self, z: np.ndarray, v: np.ndarray) -> None:
        rows, sides = self._row(z, v)
        self._rows.append(rows)
        self._sides.append(sides)

    def _add_outer_constraints(self, count: int, *, every: bool) -> bool:
        """Add constraints W >= 1.02 c at random points.

        The points are within the envelope, in the cube with z'P z > beyond c or on a face of the
        cube. Return whether W < 1.01 c at one of the points.

        count: number of points on faces
        every: whether to add constraints at all points instead of only those with W < 1.01 c
        """
        inner = self._random.uniform(-1.0, 1.0, (4 * count, len(self.M)))
        # W is least near the centers of the faces, where few uniform points are
        faces = inner[:count] * self._random.uniform(size=(count, 1))
        rows = np.arange(count)
        which = self._random.integers(0, len(self.M), count)
        faces[rows, which] = np.sign(faces[rows, which])
        far = inner[self._problem.linear_cost(inner @ self.N.T) > self._beyond * self.c]
        y = np.concatenate([faces, far])
        y = y[self._problem.in_envelope(y @ self.N.T)]
        is_low = self._W(y) < 1.01 * self.c
        self._add_high(y if every else y[is_low])
        return bool(is_low.any())

    def _add_high(self, y: np.ndarray) -> None:
        """Add the constraints W >= 1.02 c at points y (k, n)."""
        self._rows.append(self._W.monomials(y) / self.c)
        self._sides.append(np.full(len(y), 1.02))

    def _best_inputs(self, z: np.ndarray) -> np.ndarray:
        return self._problem.inputs.best(z, self._W.slope(z @ self.M.T) @ self.M)
