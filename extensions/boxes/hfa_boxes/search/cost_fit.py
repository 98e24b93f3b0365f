"""Linear programs for polynomials W that satisfy the inequality of the bound at samples.

W = s (1 - margin) z'P z plus terms of higher degree, s <= 1. W is as large as the inequality
grad W · f + z'Q z + v'R v >= 0 permits at the samples, where a part of the margin is kept in
reserve. The best inputs at a sample depend on W. Rows for the best inputs of the present W are
therefore added until none is violated (cutting planes).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from hfa_boxes.check.cover import OpenBoxError
from hfa_boxes.check.equilibrium import Equilibrium
from hfa_boxes.check.piece import Polynomial
from hfa_boxes.check.plant import Plant
from hfa_boxes.search.cost_flights import Inputs, flown_costs, running_cost
from hfa_boxes.search.monomials import Monomials

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
    Q: (n, n)
    R: (m, m)
    P: (n, n), solution of the linear quadratic problem
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
        """Inputs that minimize the Hamiltonian of a given cost gradient."""
        return Inputs(self.plant, self.equilibrium, self.R)

    def linear_cost(self, z: np.ndarray) -> np.ndarray:
        """Return z'P z at deviations z (N, n), (N,)."""
        return np.asarray(np.einsum("ki,ij,kj->k", z, self.P, z))

    def in_envelope(self, z: np.ndarray) -> np.ndarray:
        """Return the mask (N,) of the deviations z (N, n) within the state limits."""
        low, high = self.plant.ends(self.plant.states).T
        x = z + self.equilibrium.x[: z.shape[1]]
        return np.asarray(np.all((low <= x) & (x <= high), axis=1))

    def flown(self, z: np.ndarray) -> np.ndarray:
        """Return the costs (N,) of flights from z (N, n) with the saturated LQR.

        The cost is inf for a flight that leaves the envelope or does not converge.
        """
        return flown_costs(
            self.inputs,
            (self.Q, self.R, self.P),
            lambda z: np.asarray(2.0 * z @ self.P),
            self.in_envelope,
            z,
        )


class Wanted(NamedTuple):
    """Flights whose cost W is to approach from below.

    z: (N, n), initial conditions
    costs: (N,), costs of the flights
    of_least: weight of the lowest ratio of W to a cost, relative to the mean of W over samples
    """

    z: np.ndarray
    costs: np.ndarray
    of_least: float


class Fit:
    """Linear programs for one level, in coordinates y = M z.

    Samples within the envelope with z'P z <= beyond c lie in the cube |y_i| < 1.

    problem: the problem whose cost is bounded
    c: level
    wanted: flights at which W is to be large
    beyond: largest z'P z of samples as a multiple of c, above which W > c is required
    tell: called with the number of programs before each linear program. The callback may raise.
    """

    def __init__(
        self,
        problem: CostProblem,
        c: float,
        wanted: Wanted,
        beyond: float,
        tell: Callable[[int], None],
    ) -> None:
        self._problem = problem
        self.c = c
        self._wanted = wanted
        self._beyond = beyond
        self._tell = tell
        self._random = np.random.default_rng(1)
        n = len(problem.P)
        self.M = self._coordinates()
        self.N = np.linalg.inv(self.M)
        self._basis = Monomials(n, problem.degree)
        square = (1.0 - problem.margin) * self.N.T @ problem.P @ self.N
        self._fixed = self._basis.quadratic(square)
        self._orthonormal = self._combinations()
        self._coefficients = self._fixed.copy()
        self._rows: list[np.ndarray] = []
        self._sides: list[np.ndarray] = []
        self._begun = False

    def fitted(self) -> Polynomial:
        """Return the polynomial of the last linear program.

        At most `_TURNS` programs are solved. Each program adds the rows that samples violated in
        the previous one.

        Raises OpenBoxError if a program has no solution.
        """
        if not self._rows:
            z = self._ball(_FIRST)
            self._add(z, self._best_inputs(z))
            self._add_walls(_FIRST, every=True)
        for _ in range(_TURNS):
            self._tell(len(self._sides))
            self._solve()
            rows, sides = self._violated()
            has_low_wall = self._add_walls(_FIRST // 3, every=False)
            if not len(rows) and not has_low_wall:
                break
            self._rows.append(rows)
            self._sides.append(sides)
        return self._basis.polynomial(self._coefficients)

    def _violated(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows (k, K), and their sides (k,), that samples of the set violate most."""
        z = self._ball(_SAMPLES)
        z = z[self._values(z @ self.M.T) <= _NEAR_SET * self.c]
        rows, sides = self._row(z, self._best_inputs(z))
        slack = rows @ self._coefficients - sides
        worst = np.argsort(slack)[:_ADDED]
        worst = worst[slack[worst] < -_VIOLATED * self._problem.margin]
        return rows[worst], sides[worst]

    def refuted(self, y: np.ndarray) -> None:
        """Add rows at and near a point y (n,) at which a proof failed.

        At a face of the cube the rows require W >= 1.02 c, elsewhere g >= 0.
        """
        on_face = np.abs(y) == 1.0
        if np.any(on_face):
            near = np.clip(y + 0.05 * self._random.normal(size=(30, len(y))), -1.0, 1.0)
            self._add_high(np.concatenate([y[None], np.where(on_face, y, near)]))
            return
        near = y + 0.02 * self._random.normal(size=(30, len(y)))
        z = np.concatenate([y[None], near]) @ self.N.T
        self._add(z, self._best_inputs(z))

    def _coordinates(self) -> np.ndarray:
        problem = self._problem
        n = len(problem.P)
        L = np.linalg.cholesky(problem.P)
        # the least of g to second order, in ball coordinates
        G = problem.P @ problem.inputs.linear()[:, n:]
        price = problem.Q + (1.0 - problem.margin) * G @ np.linalg.pinv(problem.R) @ G.T
        inner = np.linalg.solve(L, np.linalg.solve(L, price).T)
        turn = np.linalg.eigh(0.5 * (inner + inner.T))[1]
        # ends of the axes of the ball, in z, which random samples do not reach in many dimensions
        axes = np.sqrt(self._beyond * self.c) * np.linalg.solve(L.T, turn).T
        samples = np.concatenate([self._ball(4000), axes[problem.in_envelope(axes)]])
        reach = np.abs(samples @ L @ turn).max(axis=0) * 1.02
        return np.asarray((L @ turn / reach).T)

    def _ball(self, count: int) -> np.ndarray:
        """Return random deviations z (count, n) with z'P z <= beyond c within the envelope.

        The samples are denser near 0 than a uniform sample. Fewer are returned if the envelope
        contains little of the ball.
        """
        P = self._problem.P
        n = len(P)
        L = np.linalg.cholesky(P)
        found = np.zeros((0, n))
        for _ in range(200):
            rays = self._random.normal(size=(4 * count, n))
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            radii = self._random.uniform(size=(len(rays), 1)) ** (1.5 / n)
            z = np.sqrt(self._beyond * self.c) * np.linalg.solve(L.T, (radii * rays).T).T
            found = np.concatenate([found, z[self._problem.in_envelope(z)]])
            if len(found) >= count:
                break
        return found[:count]

    def _combinations(self) -> np.ndarray:
        """Return combinations (K, k) of the monomials of degree 3 and more.

        The combinations are orthonormal over samples, which keeps the linear programs well
        conditioned.
        """
        higher = self._basis.degrees > 2
        values = self._basis.at(self._ball(_ORTHONORMAL) @ self.M.T)[:, higher]
        found = np.zeros((len(higher), int(higher.sum())))
        found[higher] = np.linalg.inv(np.linalg.qr(values)[1]) * np.sqrt(len(values))
        return found

    def _solve(self) -> None:
        """Compute the coefficients that maximize a measure of W.

        The measure is the mean over samples of W / z'P z and of W / cost at wanted flights, plus
        the weighted lowest ratio of W to the wanted costs.

        Raises OpenBoxError if the program has no solution.
        """
        rows = np.concatenate(self._rows)
        sides = np.concatenate(self._sides)
        y = self._ball(4000) @ self.M.T
        if self._begun:
            y = y[self._values(y) <= self.c]
        linear = self._problem.linear_cost(y @ self.N.T)
        gain = np.mean(self._basis.at(y) / linear[:, None], axis=0)
        wanted = self._basis.at(self._wanted.z @ self.M.T) / self._wanted.costs[:, None]
        if len(wanted):
            gain += np.mean(wanted, axis=0)
        unknowns = np.column_stack([self.c * self._orthonormal, self._fixed])
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
        self._coefficients = unknowns @ found.x[:-1]
        slack = rows @ self._coefficients - sides
        if len(rows) > _MOST_ROWS:
            kept = np.argsort(slack)[:_KEPT_ROWS]
            self._rows = [rows[kept]]
            self._sides = [sides[kept]]
        self._begun = True

    def _values(self, y: np.ndarray) -> np.ndarray:
        return np.asarray(self._basis.at(y) @ self._coefficients)

    def _row(self, z: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return rows (N, K) and right sides (N,) of the inequality at samples.

        The inequality is grad W · f + (1 - kept margin) (z'Q z + v'R v) >= 0, divided by the
        running cost.

        z: (N, n), deviations
        v: (N, m), inputs
        """
        problem = self._problem
        f = problem.inputs.rates(z, v) @ self.M.T
        rows = np.einsum("ktj,kj->kt", self._basis.slopes(z @ self.M.T), f)
        scale = running_cost(problem.Q, problem.R, z, v) + 1e-12 * self.c
        return rows / scale[:, None], np.full(len(z), -(1.0 - _KEPT * problem.margin))

    def _add(self, z: np.ndarray, v: np.ndarray) -> None:
        rows, sides = self._row(z, v)
        self._rows.append(rows)
        self._sides.append(sides)

    def _add_walls(self, count: int, *, every: bool) -> bool:
        """Add rows W >= 1.02 c at random points of the cube with z'P z > beyond c or on a face.

        Return whether W was below 1.01 c at one of the points.

        count: number of points on faces
        every: whether rows are added at all points or only where W < 1.01 c
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
        is_low = self._values(y) < 1.01 * self.c
        self._add_high(y if every else y[is_low])
        return bool(is_low.any())

    def _add_high(self, y: np.ndarray) -> None:
        """Add rows W >= 1.02 c at points y (k, n)."""
        self._rows.append(self._basis.at(y) / self.c)
        self._sides.append(np.full(len(y), 1.02))

    def _best_inputs(self, z: np.ndarray) -> np.ndarray:
        y = z @ self.M.T
        p = np.einsum("ktj,t->kj", self._basis.slopes(y), self._coefficients) @ self.M
        return self._problem.inputs.best(z, p)
