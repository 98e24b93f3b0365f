"""Al'brekht's method: the terms of a value and its policy, degree by degree, in balls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache, reduce
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from controller.expansion.taylor import PowerSeries
from controller.game.basis import Basis, monomials
from controller.game.zero_sum import Game
from controller.riccati.balls import above, ball_matrix, precision
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, NoSolutionError

if TYPE_CHECKING:
    from flint import arb_mat


@lru_cache(maxsize=64)
def homogeneous(n: int, degree: int) -> Basis:
    """Return all monomials of n variables with a degree, z1², z1 z2, z2² for n = 2."""
    exponents = monomials(n, degree)
    exponents.setflags(write=False)
    return Basis(f"degree {degree}", exponents)


def in_coordinates(weights: np.ndarray, degree: int, T: np.ndarray) -> np.ndarray:
    """Return the weights in y of k homogeneous polynomials that are given in z = T y, (k, M).

    weights: (k, M), balls
    """
    ring = PowerSeries(len(T), degree)
    parts = T @ ring.variables()
    factors = (np.repeat(parts, powers, axis=0) for powers in monomials(len(T), degree))
    psi = [reduce(ring.product, each) for each in factors]
    return weights @ np.array(psi)[:, ring.of[degree]]


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


#: Largest difference between A or B of the game and of the aircraft, relative to the largest entry
#: of its row and column.
TOLERANCE = 1e-8
#: Least number of bits of the balls.
BITS_OF_SERIES = 256


def series_of_game(
    solution: Solution, rates: ca.Function, order: int
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the terms V2, ..., VD of a value and u1, ..., u_{D-1} of its policy.

    The terms of degree d of the equation of `Expansion` are linear in V_d:
    ∂V_d/∂z'(A - B K + E L) z = -(terms of V2 ... V_{d-1}), which is solved for the weights of V_d.
    The stationarity with respect to u then gives u_{d-1}. A and B are those of the game. All
    weights are balls that contain the exact ones, (M,) of V_d and (m, M) of u_d.

    solution: exact solution of the linear game
    rates: CasADi Function (z, u) -> F(z, u)
    order: degree D of the value

    Source: E. G. Al'brekht, On the optimal stabilization of nonlinear systems, J. Appl. Math. Mech.
    25 (1961); A. J. van der Schaft, IEEE Trans. Automatic Control 37 (1992) 770-784.
    """
    from flint import arb

    game, proved = solution.game, solution.enclosure
    n, m = rates.size1_in(0), rates.size1_in(1)
    with precision(max(BITS_OF_SERIES, proved.bits)):
        A, B, E, N, R = map(balls, (game.A, game.B, game.E, game.N, game.R))
        P, K = balls(proved.P), balls(proved.K)
        w = arb(1) / arb(game.delta) ** 2 if math.isfinite(game.delta) else arb(0)
        loop = A - B @ K + w * (E @ (E.T @ P))
        both = _rates_and_slope(rates)
        exact = _linear_part(both, game)
        change = np.hstack([A, B]) - exact
        sizes = 1.0 / np.sqrt(np.diag(solution.P))  # units in which a linear equation is solved
        rows, columns = np.triu_indices(n)
        value, policy = [P[rows, columns] * np.where(rows == columns, 1, 2)], [-K]
        for degree in range(3, order + 1):
            ring = PowerSeries(n, degree)
            of_degree, V, z = ring.of[degree], ring.constant(0), ring.variables()
            V[ring.of[2].start : of_degree.start] = np.concatenate(value)
            u = np.full((m, len(V)), arb(0))
            u[:, 1 : ring.of[degree - 2].stop] = np.hstack(policy)
            slope = ring.gradient(V)
            f = ring.values(both, np.vstack([z, u, slope]))[:n] + change @ np.vstack([z, u])
            # λ'F + u'Ru + 2 z'Nu + λ'E E'λ / 4δ²; u_{d-1} has no share: it is times ∂H/∂u = 0
            worst = E.T @ slope
            one = np.vstack([slope, u, z, worst])
            other = np.vstack([f, R @ u, 2 * N @ u, w / 4 * worst])
            known = np.sum([*map(ring.product, one, other)], axis=0)[of_degree]
            raised = np.array(ring.products[1 : 1 + n])[:, ring.of[degree - 1]]  # z_i z^a
            of_V = np.full((len(V), len(V)), arb(0))  # weights of V_d -> those of ∂V_d/∂z' loop z
            for i, j in np.ndindex(n, n):
                of_V[raised[j], raised[i]] += ring.exponents[raised[i], i] * loop[i, j]
            by = homogeneous(n, degree).psi(sizes).astype(object)
            equation = by[:, None] * of_V[of_degree, of_degree] / by
            value.append(_solved(equation, -(by * known)[:, None])[:, 0] / by)
            V[of_degree] = value[-1]
            slope = ring.gradient(V)
            of_u = ring.values(both, np.vstack([z, u, slope]))[n:] + change[:, n:].T @ slope
            policy.append(_solved(R, of_u[:, ring.of[degree - 1]] / -2))
    return value, policy


def balls(matrix: np.ndarray | arb_mat) -> np.ndarray:
    """Return a matrix of doubles or balls as an array of balls."""
    exact = ball_matrix(matrix) if isinstance(matrix, np.ndarray) else matrix
    return np.array(exact.entries(), dtype=object).reshape(exact.nrows(), exact.ncols())


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return X of matrix X = right, of balls."""
    from flint import arb_mat

    return balls(arb_mat(matrix.tolist()).solve(arb_mat(right.tolist())))


def _rates_and_slope(rates: ca.Function) -> ca.Function:
    """Return the CasADi Function (z, u, λ) -> F and ∂(λ'F)/∂u, one vector -> one vector."""
    z, u = rates.sx_in()
    slope = ca.SX.sym("slope", z.numel())
    f = rates(z, u)
    results = ca.vertcat(f, ca.gradient(ca.dot(slope, f), u))
    return ca.Function("rates", [ca.vertcat(z, u, slope)], [ca.densify(results)])


def _linear_part(both: ca.Function, game: Game) -> np.ndarray:
    """Return the derivatives [A B] of the rates, of which those of the game are rounded."""
    n = len(game.A)
    ring = PowerSeries(both.numel_in(0), 1)
    found = ring.values(both, ring.variables())[:n, 1 : both.numel_in(0) - n + 1]
    for name, given, exact in (("A", game.A, found[:, :n]), ("B", game.B, found[:, n:])):
        sizes = np.abs(exact.astype(float))
        # in any units, which scale rows and columns
        least = np.minimum(sizes.max(axis=1, keepdims=True), sizes.max(axis=0))
        if given.shape != exact.shape or np.any(abs(given - exact) > TOLERANCE * least):
            raise BadInputError(
                f"{name} of the game is not the linear model at this trim; give the linear model "
                "of which the game was made"
            )
    return found


def relative_radius(terms: Sequence[np.ndarray], size: float) -> float:
    """Return the largest radius of the terms of degree d, d + 1, ... where |y| = size, relative to
    the largest of them.
    """
    there = [(ball, size**k) for k, term in enumerate(terms) for ball in term.flat]
    largest = max(abs(float(ball)) * by for ball, by in there)
    return max(above(ball.rad()) * by for ball, by in there) / largest


def nominal_size(root: np.ndarray, nominal: np.ndarray) -> float:
    """Return the size |y|, y = root'z, of the set that reaches the nominal value of a state."""
    farthest = np.linalg.norm(np.linalg.inv(root.T), axis=1)  # largest |z_i| for |y| = 1
    return float(np.min(nominal / farthest))


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
