"""Al'brekht's method: the terms of a value and its policy, degree by degree, in balls."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from controller.expansion.taylor import PowerSeries, Terms
from controller.game.basis import Basis, monomials
from controller.riccati.balls import above, ball_matrix, midpoints, precision
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, NoSolutionError


@lru_cache(maxsize=64)
def homogeneous(n: int, degree: int) -> Basis:
    """Return all monomials of n variables with a degree, z1², z1 z2, z2² for n = 2."""
    exponents = monomials(n, degree)
    exponents.setflags(write=False)
    return Basis(f"degree {degree}", exponents)


def in_coordinates(weights: np.ndarray, degree: int, T: arb_mat) -> np.ndarray:
    """Return the weights in y of k homogeneous polynomials that are given in z = T y, (k, M).

    weights: (k, M), balls
    """
    ring = PowerSeries(T.ncols(), degree)
    z = [ring.linear(row, ring.variables()) for row in T.tolist()]
    psi = products_of(z, degree, ring.product, {0: arb(1)})
    return np.array([ring.of_degree(ring.linear(row, psi), degree) for row in weights])


def polynomial(y: ca.SX, degree: int, weights: np.ndarray) -> ca.SX:
    """Return homogeneous polynomials W ψ(y) as CasADi expressions, (k,).

    y: (n,), expressions
    degree: degree of the monomials ψ
    weights: W, (k, M)
    """
    psi = products_of(ca.vertsplit(y), degree, operator.mul, ca.SX(1.0))
    return ca.densify(ca.DM(weights) @ ca.vertcat(*psi))


def products_of(parts: list[Any], degree: int, times: Callable[..., Any], one: Any) -> list[Any]:
    """Return the products of all monomials of a degree of n parts, in the order of `homogeneous`.

    times: function that multiplies two of them
    one: the product of none
    """
    # (a, b, c) -> y_a y_b y_c; a <= b <= c, so that each monomial is made once
    products: dict[tuple[int, ...], Any] = {(): one}
    for _ in range(degree):
        products = {
            (*factors, following): times(product, parts[following])
            for factors, product in products.items()
            for following in range(factors[-1] if factors else 0, len(parts))
        }
    return list(products.values())


def name_of(exponents: Sequence[int], names: Sequence[str]) -> str:
    """Return a monomial as text, such as "speed*alpha**2".

    exponents: (n,)
    names: names of the n variables
    """
    factors = [
        name if power == 1 else f"{name}**{power}"
        for name, power in zip(names, exponents, strict=True)
        if power
    ]
    return "*".join(factors)


class SeriesOfGame(NamedTuple):
    """Terms of a value and of its policy, in balls that contain the exact ones.

    value: V2, V3, ..., weights of all monomials of the degree, (M,) each
    policy: u1, u2, ..., weights of all monomials, (m, M) each
    """

    value: list[np.ndarray]
    policy: list[np.ndarray]


def series_of_game(solution: Solution, rates: ca.Function, order: int) -> SeriesOfGame:
    """Return the terms V2, ..., VD of a value and u1, ..., u_{D-1} of its policy.

    The terms of degree d of the equation of `Expansion` are linear in V_d:
    ∂V_d/∂z'(A - B K + E L) z = -(terms of V2 ... V_{d-1}), which is solved for the weights of V_d.
    The stationarity with respect to u then gives u_{d-1}. A and B are those of the game.

    solution: exact solution of the linear game
    rates: CasADi Function (z, u) -> F(z, u)
    order: degree D of the value

    Source: E. G. Al'brekht, On the optimal stabilization of nonlinear systems, J. Appl. Math. Mech.
    25 (1961); A. J. van der Schaft, IEEE Trans. Automatic Control 37 (1992) 770-784.
    """
    with precision(max(BITS_OF_SERIES, solution.enclosure.bits)):
        game = _Game(solution, rates)
        found = SeriesOfGame([], [])
        for degree in range(2, order + 1):
            value, policy = game.terms(found, degree)
            found.value.append(value)
            found.policy.append(policy)
    return found


def _other_plant(name: str) -> BadInputError:
    """Return the error of a game with another A or B than the derivatives of the rates."""
    return BadInputError(
        f"{name} of the game is not the linear model at this trim; give the linear model of which "
        "the game was made"
    )


#: Largest difference between A or B of the game and of the aircraft, relative to the largest entry
#: of its row and column.
TOLERANCE = 1e-8
#: Least number of bits of the balls.
BITS_OF_SERIES = 256


class _Game:
    """The equation of a nonlinear game, whose terms are evaluated in balls."""

    def __init__(self, solution: Solution, rates: ca.Function) -> None:
        game, enclosure = solution.game, solution.enclosure
        self.n, self.m = rates.size1_in(0), rates.size1_in(1)
        self.A, self.B, self.E, self.N = map(ball_matrix, (game.A, game.B, game.E, game.N))
        self.Q, self.R = ball_matrix(game.Q), ball_matrix(game.R)
        self.P, self.K, self.w = enclosure.P, enclosure.K, arb(1) / (arb(game.delta) ** 2)
        if not math.isfinite(game.delta):
            self.w = arb(0)
        self.loop = self.A - self.B * self.K + self.E * self.E.transpose() * self.P * self.w
        if game.B.shape != (self.n, self.m):
            raise _other_plant("B")
        z, u = rates.sx_in()
        gradient = ca.SX.sym("gradient", self.n)
        f = rates(z, u)
        slope = ca.densify(ca.gradient(ca.dot(gradient, f), u))
        self.rates = ca.Function("rates", [z, u], [ca.densify(f)])
        self.slope = ca.Function("slope", [z, u, gradient], [slope])
        # A and B of the game are the derivatives of the rates, rounded.
        ring = PowerSeries(self.n + self.m, 1)
        rows = [ring.of_degree(row, 1) for row in ring.values(self.rates, ring.variables())]
        exact = [ball_matrix([row[part] for row in rows]) for part in np.s_[: self.n, self.n :]]
        self.A_change, self.B_change = self.A - exact[0], self.B - exact[1]
        for name, change, matrix in zip("AB", (self.A_change, self.B_change), exact, strict=True):
            sizes = np.abs(midpoints(matrix))
            # in any units, which scale rows and columns
            least = np.minimum(sizes.max(axis=1)[:, None], sizes.max(axis=0))
            if not (np.abs(midpoints(change)) <= TOLERANCE * least).all():
                raise _other_plant(name)

    def terms(self, found: SeriesOfGame, degree: int) -> tuple[np.ndarray, np.ndarray]:
        """Return V_d, (M,), and u_{d-1}, (m, M), from the terms of lower degrees."""
        low, ring = PowerSeries(self.n, degree - 1), PowerSeries(self.n, degree)
        z = ring.variables()
        if degree == 2:
            return self._quadratic(ring)
        V: Terms = {}
        for known, weights in enumerate(found.value, 2):
            V |= dict(zip(ring.monomials(known), weights, strict=True))
        u: list[Terms] = [{} for _ in range(self.m)]
        for known, rows in enumerate(found.policy, 1):
            for series, weights in zip(u, rows, strict=True):
                series |= dict(zip(ring.monomials(known), weights, strict=True))
        slopes = ring.gradient(V)
        f = low.values(self.rates, [*z, *u])
        changes = zip(self.A_change.tolist(), self.B_change.tolist(), strict=True)
        f = [
            ring.sum(row, ring.linear([*of_z, *of_u], [*z, *u]))
            for row, (of_z, of_u) in zip(f, changes, strict=True)
        ]
        # λ'F + u'Ru + 2 z'Nu + λ'E E'λ / 4δ²; u_{d-1} has no share, because it is times ∂H/∂u = 0
        pairs = [*zip(slopes, f, strict=True)]
        R_u = [ring.linear(row, u) for row in self.R.tolist()]
        N_u = [ring.linear([2 * entry for entry in row], u) for row in self.N.tolist()]
        pairs += [*zip(u, R_u, strict=True), *zip(z, N_u, strict=True)]
        for row in self.E.transpose().tolist():
            worst = ring.linear(row, slopes)
            pairs.append((worst, ring.linear([self.w / 4], [worst])))
        known_terms: Terms = {}
        for one, other in pairs:
            known_terms = ring.sum(known_terms, ring.product(one, other))
        right = arb_mat([[-term] for term in ring.of_degree(known_terms, degree)])
        new = self._slope_of_monomials(ring, degree).solve(right).entries()
        V |= dict(zip(ring.monomials(degree), new, strict=True))
        slopes = ring.gradient(V)
        of_u = low.values(self.slope, [*z, *u, *slopes])
        B_change = self.B_change.transpose().tolist()
        of_u = [
            low.sum(row, low.linear(change, slopes))
            for row, change in zip(of_u, B_change, strict=True)
        ]
        right = ball_matrix([low.of_degree(row, degree - 1) for row in of_u]) * arb(-0.5)
        return np.array(new), np.array(self.R.solve(right).tolist())

    def _quadratic(self, ring: PowerSeries) -> tuple[np.ndarray, np.ndarray]:
        """Return V2 = z'Pz and u1 = -K z."""
        rows = self.P.tolist()
        pairs = combinations_with_replacement(range(self.n), 2)
        value = [rows[i][j] * (1 if i == j else 2) for i, j in pairs]
        return np.array(value), np.array((-self.K).tolist())

    def _slope_of_monomials(self, ring: PowerSeries, degree: int) -> arb_mat:
        """Return the matrix of the weights of V_d -> those of ∂V_d/∂z' (loop z)."""
        loop = [ring.linear(row, ring.variables()) for row in self.loop.tolist()]
        monomials = ring.monomials(degree)
        rows = {monomial: row for row, monomial in enumerate(monomials)}
        entries = [[arb(0)] * len(monomials) for _ in monomials]
        for column, monomial in enumerate(monomials):
            for slope, rate in zip(ring.gradient({monomial: arb(1)}), loop, strict=True):
                for key, coefficient in ring.product(slope, rate).items():
                    entries[rows[key]][column] += coefficient
        return arb_mat(entries)


def relative_radius(balls: np.ndarray, least: float) -> float:
    """Return the largest radius of balls relative to their largest midpoint, or to `least`."""
    largest = max(abs(float(ball)) for ball in balls.flat)
    radius = max(0.0 if arb(ball).is_exact() else above(arb(ball).rad()) for ball in balls.flat)
    return radius / max(largest, least) if radius else 0.0


def nominal_size(root: np.ndarray, nominal: np.ndarray) -> float:
    """Return the size |y|, y = root'z, of the set that reaches the nominal value of a state."""
    farthest = np.linalg.norm(np.linalg.inv(root.T), axis=1)  # largest |z_i| for |y| = 1
    return float(np.min(nominal / farthest))


def middle(balls: np.ndarray) -> np.ndarray:
    """Return the midpoints of balls as doubles, in the same shape."""
    return np.vectorize(float, otypes=[float])(balls)


def directions(n: int, count: int, seed: int) -> np.ndarray:
    """Return random unit vectors, (count, n)."""
    vectors = np.random.default_rng(seed).standard_normal((count, n))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def root_of(P: np.ndarray) -> np.ndarray:
    """Return the lower triangular root with P = root root', (n, n).

    Raises NoSolutionError if P is not positive definite.
    """
    try:
        return np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise NoSolutionError(
            "P is singular within rounding: some deviations cost nothing; give Q a weight on "
            "these states, or leave them out of the linear model"
        ) from None
