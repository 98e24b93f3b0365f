"""Al'brekht's method: the terms of a value and its policy, degree by degree, on rays."""

from __future__ import annotations

import numpy as np

from controller.expansion.monomials import homogeneous, monomial_scales
from controller.expansion.rays import Rays
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_support.errors import NoSolutionError

#: Number of rays for each unknown coefficient of the highest degree, and the least number of rays.
_RAYS_PER_COEFFICIENT = 1.5
_LEAST_RAYS = 20
#: Seed of the directions of the rays. The terms do not depend on it, except for rounding.
_SEED = 1961
#: Number of rays whose monomials are differentiated at once.
_TOGETHER = 256


class Series:
    """Terms V2, V3, ... of a value and u1, u2, ... of its policy, found one degree at a time.

    The coefficient of t^d of the equation of `Expansion` on the ray t z is linear in V_d:
    ∂V_d/∂z'(A - B K + E L) z = -(terms of V2 ... V_{d-1}). The stationarity with respect to u then
    gives u_{d-1}. Both are solved by least squares on more rays than there are coefficients, in the
    coordinates y = root'z with P = root root', where V2 = |y|².

    value: weights of V2, V3, ..., (M,) each, of the monomials of y, scaled by `monomial_scales`
    policy: weights of u1, u2, ..., (m, M) each, of the same monomials

    Source: E. G. Al'brekht, On the optimal stabilization of nonlinear systems, J. Appl. Math. Mech.
    25 (1961); A. J. van der Schaft, IEEE Trans. Automatic Control 37 (1992) 770-784.
    """

    def __init__(self, solution: Solution, rays: Rays, degree: int) -> None:
        """Start with V2 and u1 of the linear game.

        solution: exact solution of the linear game
        rays: coefficients of the rates
        degree: highest degree of the value

        Raises NoSolutionError if P is singular.
        """
        n = len(solution.P)
        count = max(_LEAST_RAYS, int(_RAYS_PER_COEFFICIENT * homogeneous(n, degree).size))
        self._game = solution.game
        self._rays = rays
        self.root = root_of(solution.P)
        self._loop_in_y = in_root(solution.game.worst_case_loop(solution.P), self.root)
        self._y = directions(n, count, _SEED)  # directions of the rays, (count, n)
        self._z = np.linalg.solve(self.root.T, self._y.T)  # the same in z, (n, count)
        self._gradients_in_z = [2.0 * self.root @ self._y.T]  # ∂V2/∂z = 2 P z on the rays
        self._inputs = [-solution.K @ self._z]  # u1 = -K z on the rays
        self.value = [homogeneous(n, 2).weights(np.eye(n)) / monomial_scales(n, 2)]  # V2 = |y|²
        self.policy = [-np.linalg.solve(self.root, solution.K.T).T]  # u1 = -K root'⁻¹ y

    def add_degree(self) -> None:
        """Find the next terms, V_d and u_{d-1}."""
        d = len(self.value) + 2
        gradients = [*self._gradients_in_z, np.zeros_like(self._z)]
        inputs = [*self._inputs, np.zeros_like(self._inputs[0])]
        known, _ = coefficient(self._game, self._rays, self._z, inputs, gradients)
        n = len(self.root)
        slopes = _slopes(self._y, d, self._y @ self._loop_in_y.T)
        weights = least_squares(slopes, -known[:, None])
        gradients[-1] = self.root @ gradient(self._y, d, weights[:, 0]).T
        _, derivative = self._rays(self._z, inputs, gradients)
        inputs[-1] = -0.5 * np.linalg.solve(self._game.R, derivative)
        psi = homogeneous(n, d - 1).psi(self._y) * monomial_scales(n, d - 1)
        policy = least_squares(psi, inputs[-1].T)
        self._gradients_in_z = gradients
        self._inputs = inputs
        self.value.append(weights[:, 0])
        self.policy.append(policy.T)


def coefficient(
    game: Game, rays: Rays, z: np.ndarray, inputs: list[np.ndarray], gradients: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficient of t^d of the equation of `Expansion`, and the size of its terms.

    Both have the shape (N,). The size is the sum of the magnitudes of all products.

    game: weights of the game, and E
    rays: coefficients of the rates
    z: (n, N), directions of the rays
    inputs: u1 ... u_{d-1}, (m, N) each
    gradients: ∂V2/∂z ... ∂V_d/∂z on the rays, (n, N) each
    """
    order = len(gradients)
    products: list[np.ndarray] = []
    for k in range(1, order + 1):
        rates, _ = rays(z, inputs[:k], gradients[:k])
        products.append(rates * gradients[order - k])
        products.append(inputs[k - 1] * (game.R @ inputs[order - k]))
        worst = [game.E.T @ gradients[index] / (2.0 * game.delta) for index in (k - 1, order - k)]
        products.append(worst[0] * worst[1])
    products.append(2.0 * z * (game.N @ inputs[-1]))
    if order == 1:
        products.append(z * (game.Q @ z))
    terms = np.vstack(products)
    return terms.sum(axis=0), np.abs(terms).sum(axis=0)


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


def least_squares(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return X (M, k) that minimizes |matrix X - right|, with one correction by the residual.

    matrix: (N, M), N > M
    right: (N, k)
    """
    basis, triangle = np.linalg.qr(matrix)
    X = np.linalg.solve(triangle, basis.T @ right)
    return X + np.linalg.solve(triangle, basis.T @ (right - matrix @ X))


def in_root(A: np.ndarray, root: np.ndarray) -> np.ndarray:
    """Return the matrix of z' = A z in the coordinates y = root'z, (n, n)."""
    return np.linalg.solve(root, (root.T @ A).T).T


def gradient(y: np.ndarray, degree: int, weights: np.ndarray) -> np.ndarray:
    """Return the gradient of a homogeneous polynomial of y at N points, (N, n).

    y: (N, n), points
    weights: (M,), of the scaled monomials of the degree
    """
    basis = homogeneous(y.shape[1], degree)
    weights = weights * monomial_scales(y.shape[1], degree)
    return np.vstack([weights @ basis.gradient(block) for block in _blocks(y)])


def _slopes(y: np.ndarray, degree: int, moved: np.ndarray) -> np.ndarray:
    """Return the derivatives of all scaled monomials of a degree in given directions, (N, M).

    y: (N, n), points
    moved: (N, n), direction at each point
    """
    basis = homogeneous(y.shape[1], degree)
    blocks = zip(_blocks(y), _blocks(moved), strict=True)
    slopes = [(basis.gradient(points) @ motion[..., None])[..., 0] for points, motion in blocks]
    return np.vstack(slopes) * monomial_scales(y.shape[1], degree)


def _blocks(rows: np.ndarray) -> list[np.ndarray]:
    """Return rows in blocks of `_TOGETHER`, whose gradients fit into memory."""
    return np.split(rows, range(_TOGETHER, len(rows), _TOGETHER))
