"""Al'brekht's method: the terms of a value and its policy, degree by degree, on rays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, permutations

import casadi as ca
import numpy as np

from controller.game.basis import Basis, monomials
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, NoSolutionError


@lru_cache(maxsize=64)
def homogeneous(n: int, degree: int) -> Basis:
    """Return all monomials of n variables with a degree, z1², z1 z2, z2² for n = 2."""
    exponents = monomials(n, degree)
    exponents.setflags(write=False)
    return Basis(f"degree {degree}", exponents)


@lru_cache(maxsize=64)
def monomial_scales(n: int, degree: int) -> np.ndarray:
    """Return sqrt(d! / (a1! ... an!)) of each monomial z^a of a degree d, (M,).

    With these factors, the squares of all monomials sum to |z|^(2 d), and a rotation of z changes
    the weights by an orthogonal matrix.
    """
    counts = [
        math.factorial(degree) / math.prod(map(math.factorial, row))
        for row in homogeneous(n, degree).exponents.tolist()
    ]
    return np.sqrt(counts)


def in_coordinates(weights: np.ndarray, degree: int, T: np.ndarray) -> np.ndarray:
    """Return the weights in z of a homogeneous polynomial that is given in y = T z, (k, M).

    A polynomial of degree 3 is Σ C_abc y_a y_b y_c with a symmetric array C, of which an entry is
    the weight of its monomial divided by the number of permutations of (a, b, c). In z, each axis
    of C is multiplied by T.

    weights: (k, M), k polynomials of the given degree
    degree: their degree
    T: (n, n)
    """
    n = len(T)
    factors = list(combinations_with_replacement(range(n), degree))  # (a, b, c) of y_a y_b y_c
    arrangements = monomial_scales(n, degree) ** 2  # number of permutations of (a, b, c)
    entries = weights / arrangements
    C = np.zeros((*(n,) * degree, len(weights)))  # C_abc of each polynomial
    for monomial, indices in enumerate(factors):
        for permuted in set(permutations(indices)):
            C[permuted] = entries[:, monomial]
    for axis in range(degree):  # y_a = sum of T_ai z_i
        C = np.moveaxis(np.tensordot(T, C, axes=(0, axis)), 0, axis)
    in_z = [C[indices] for indices in factors]
    return np.stack(in_z, axis=1) * arrangements


def polynomial(y: ca.SX, degree: int, weights: np.ndarray) -> ca.SX:
    """Return homogeneous polynomials W ψ(y) as CasADi expressions, (k,).

    y: (n,), expressions
    degree: degree of the monomials ψ
    weights: W, (k, M), of the monomials scaled by `monomial_scales`
    """
    # (a, b, c) -> y_a y_b y_c; a <= b <= c, so that each monomial is made once
    products: dict[tuple[int, ...], ca.SX] = {(): ca.SX(1.0)}
    for _ in range(degree):
        products = {
            (*factors, following): product * y[following]
            for factors, product in products.items()
            for following in range(factors[-1] if factors else 0, y.numel())
        }
    psi = ca.vertcat(*products.values()) * ca.DM(monomial_scales(y.numel(), degree))
    return ca.densify(ca.DM(weights) @ psi)


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


class Rays:
    """Taylor coefficients of the rates F(z, u) along rays, computed at many rays at once.

    The ray is t -> (t z, t u1 + t² u2 + ...), with the coefficients f1, f2, ... of the rates. Along
    the gradient λ(t) = t λ1 + t² λ2 + ... of a value, the derivative of λ'F with respect to u has
    the coefficients g1, g2, ...
    """

    def __init__(self, rates: ca.Function, highest: int) -> None:
        """Differentiate the rates.

        rates: CasADi Function (z, u) -> F(z, u)
        highest: order of the last coefficient
        """
        n = rates.size1_in(0)
        m = rates.size1_in(1)
        t = ca.SX.sym("t")
        z = ca.SX.sym("z", n)
        u = [ca.SX.sym(f"u{order}", m) for order in range(1, highest + 1)]
        gradients = [ca.SX.sym(f"l{order}", n) for order in range(1, highest + 1)]
        u_on_ray = sum((t**order * part for order, part in enumerate(u, 1)), ca.SX.zeros(m))
        derivative = rates(t * z, u_on_ray)
        f: list[ca.SX] = []  # f1, f2, ...: derivatives at t = 0 over 1!, 2!, ...
        self._functions = []
        for order in range(1, highest + 1):
            derivative = ca.jacobian(derivative, t)
            f.append(ca.substitute(derivative, t, 0) / math.factorial(order))
            # The coefficient k + 1 of λ'F is λ1'f_k + λ2'f_(k-1) + ... + λk'f1. Its derivative with
            # respect to u1, which acts as t u1, is the coefficient g_k of ∂(λ'F)/∂u.
            terms = zip(f, reversed(gradients[:order]), strict=True)
            product = sum((ca.dot(rate, gradient) for rate, gradient in terms), ca.SX(0))
            arguments = [z, *u[:order], *gradients[:order]]
            results = [ca.densify(f[-1]), ca.densify(ca.gradient(product, u[0]))]
            self._functions.append(ca.Function(f"ray{order}", arguments, results))

    def __call__(
        self, z: np.ndarray, u: list[np.ndarray], gradients: list[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients f_k (n, N) and g_k (m, N) on N rays.

        z: (n, N), directions
        u: k arrays (m, N), u1 ... uk. g_k does not depend on uk.
        gradients: k arrays (n, N), λ1 ... λk

        Raises BadInputError if a derivative is not finite.
        """
        results = self._functions[len(u) - 1](z, *u, *gradients)
        rates, slopes = (np.array(result) for result in results)
        if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
            raise BadInputError(
                f"the derivatives of order {len(u)} of the equations are not finite at the trim; "
                "choose a lower order or another trim"
            )
        return rates, slopes


#: Number of rays for each unknown coefficient of the highest degree, and the least number of rays.
_RAYS_PER_COEFFICIENT = 1.5
_LEAST_RAYS = 20
#: Seed of the directions of the rays. The terms do not depend on it, except for rounding.
_SEED = 1961
#: Number of rays whose monomials are differentiated at once.
_RAYS_PER_BLOCK = 256


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
        worst_loop = solution.game.worst_case_loop(solution.P)
        # y' = root'A root'⁻¹ y of z' = A z in the coordinates y = root'z
        self._loop_in_y = np.linalg.solve(self.root, (self.root.T @ worst_loop).T).T
        self._y = directions(n, count, _SEED)  # directions of the rays, (count, n)
        self._z = np.linalg.solve(self.root.T, self._y.T)  # the same in z, (n, count)
        self._gradients_in_z = [2.0 * self.root @ self._y.T]  # ∂V2/∂z = 2 P z on the rays
        self._inputs = [-solution.K @ self._z]  # u1 = -K z on the rays
        self.value = [homogeneous(n, 2).weights(np.eye(n)) / monomial_scales(n, 2)]  # V2 = |y|²
        self.policy = [-np.linalg.solve(self.root, solution.K.T).T]  # u1 = -K root'⁻¹ y

    def add_degree(self) -> None:
        """Find the next terms, V_d and u_{d-1}."""
        d = len(self.value) + 2
        gradients = [*self._gradients_in_z, np.zeros_like(self._z)]  # the unknown V_d as 0
        # u_{d-1} may be 0: the equation has it times 2 R u1 + 2 N'z + B'λ1, which is 0.
        inputs = [*self._inputs, np.zeros_like(self._inputs[0])]
        known, _ = coefficient(self._game, self._rays, self._z, inputs, gradients)
        n = len(self.root)
        slopes = _slopes(self._y, d, self._y @ self._loop_in_y.T)  # ∂V_d/∂y y' of the linear loop
        weights = least_squares(slopes, -known[:, None])
        gradients[-1] = self.root @ gradient(self._y, d, weights[:, 0]).T  # ∂V/∂z = root ∂V/∂y
        _, derivative = self._rays(self._z, inputs, gradients)
        inputs[-1] = -0.5 * np.linalg.solve(self._game.R, derivative)  # 2 R u + ∂(λ'F)/∂u = 0
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
    last_order = len(gradients)  # d - 1
    # With λ = ∂V/∂z, the worst disturbance is δ w = E'λ / 2δ, for which λ'E w - δ² w'w = δ² w'w. Of
    # the equation λ'F + u'Ru + δ²w'w + 2 z'Nu + z'Qz, add the products of a factor of order k and
    # one of order d - k, k = 1 ... d - 1. The entry of order k in a list has the index k - 1.
    products: list[np.ndarray] = []
    delta_w = [game.E.T @ gradient_in_z / (2.0 * game.delta) for gradient_in_z in gradients]
    for k in range(1, last_order + 1):
        rates, _ = rays(z, inputs[:k], gradients[:k])
        products.append(rates * gradients[last_order - k])
        products.append(inputs[k - 1] * (game.R @ inputs[last_order - k]))
        products.append(delta_w[k - 1] * delta_w[last_order - k])
    products.append(2.0 * z * (game.N @ inputs[-1]))  # z has the order 1 only
    if last_order == 1:  # z'Qz has the degree 2 only
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


def least_squares(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return X (M, k) that minimizes |matrix X - values|, with one correction by the residual.

    matrix: (N, M), N > M
    values: (N, k)
    """
    orthogonal, triangle = np.linalg.qr(matrix)
    X = np.linalg.solve(triangle, orthogonal.T @ values)
    return X + np.linalg.solve(triangle, orthogonal.T @ (values - matrix @ X))


def gradient(y: np.ndarray, degree: int, weights: np.ndarray) -> np.ndarray:
    """Return the gradient of a homogeneous polynomial of y at N points, (N, n).

    y: (N, n), points
    weights: (M,), of the scaled monomials of the degree
    """
    basis = homogeneous(y.shape[1], degree)
    weights = weights * monomial_scales(y.shape[1], degree)
    return np.vstack([weights @ basis.gradient(block) for block in _blocks(y)])


def _slopes(y: np.ndarray, degree: int, y_rates: np.ndarray) -> np.ndarray:
    """Return the derivatives of all scaled monomials of a degree at N points y, (N, M).

    They are along y_rates: the rate of each monomial if y changes at these rates.

    y, y_rates: (N, n) each
    """
    basis = homogeneous(y.shape[1], degree)
    blocks = zip(_blocks(y), _blocks(y_rates), strict=True)
    slopes = [(basis.gradient(points) @ rates[..., None])[..., 0] for points, rates in blocks]
    return np.vstack(slopes) * monomial_scales(y.shape[1], degree)


def _blocks(rows: np.ndarray) -> list[np.ndarray]:
    """Return rows in blocks of `_RAYS_PER_BLOCK`, whose gradients fit into memory."""
    return np.split(rows, range(_RAYS_PER_BLOCK, len(rows), _RAYS_PER_BLOCK))
