"""Value and policies of the nonlinear game about a trim, to a given degree."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from controller.expansion.deviations import deviation_rates
from controller.expansion.monomials import in_coordinates, monomials, polynomial, sizes
from controller.expansion.rays import Rays
from controller.expansion.series import Series, coefficient, directions, gradient
from controller.game.basis import Basis
from controller.game.zero_sum import Game
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, NoSolutionError
from trim.linear.linear_model import LinearModel

#: Permitted degrees of a value.
LOWEST = 2
HIGHEST = 5
#: Largest number of coefficients of one degree.
MOST = 2500
#: Largest relative residual of the equation that counts as rounding.
LARGEST_RESIDUAL = 1e-10
#: Number and seed of the rays on which the residuals are computed.
_RAYS = 100
_SEED = 1992


@dataclass(frozen=True, eq=False, repr=False)
class Expansion:
    """Value V = V2 + ... + VD of a nonlinear game and its policies, as polynomials of z.

    min_u max_d  ∂V/∂z'(F(z, u) + E d) + z'Qz + 2z'Nu + u'Ru - δ² d'd = O(|z|^(D+1))

    V2 = z'Pz is the value of the linear game. The disturbance is added to the rates: E is that of
    the linear game.

    degree: D
    solution: exact solution of the linear game
    rates: CasADi Function (z, u) -> F(z, u), the rates of the deviations from the trim
    root: (n, n), lower triangular, P = root root'. The terms are polynomials of y = root'z.
    value_terms: V2, V3, ..., as weights (M,) of the monomials of y, scaled by `sizes`
    policy_terms: u1, u2, ..., as weights (m, M) of the same monomials
    """

    degree: int
    solution: Solution
    rates: ca.Function
    root: np.ndarray
    value_terms: tuple[np.ndarray, ...]
    policy_terms: tuple[np.ndarray, ...]

    @property
    def game(self) -> Game:
        """The linear game, which has the weights of the nonlinear one."""
        return self.solution.game

    @property
    def states(self) -> int:
        """Number n of states."""
        return len(self.game.A)

    @property
    def basis(self) -> Basis:
        """Monomials of degree 2 to D."""
        return monomials(self.states, *range(LOWEST, self.degree + 1))

    @property
    def policy_basis(self) -> Basis:
        """Monomials of degree 1 to D - 1."""
        return monomials(self.states, *range(1, self.degree))

    @cached_property
    def weights(self) -> np.ndarray:
        """Weights of V, (M,), of the monomials in `basis`."""
        terms = enumerate(self.value_terms, LOWEST)
        return np.concatenate([self._in_z(term[None], degree)[0] for degree, term in terms])

    @cached_property
    def policy_weights(self) -> np.ndarray:
        """Weights of u, (m, K), of the monomials in `policy_basis`."""
        terms = enumerate(self.policy_terms, 1)
        return np.hstack([self._in_z(term, degree) for degree, term in terms])

    def _in_z(self, weights: np.ndarray, degree: int) -> np.ndarray:
        """Return weights of the monomials of z, of weights of the scaled monomials of y, (k, M)."""
        return in_coordinates(weights * sizes(self.states, degree), degree, self.root.T)

    @cached_property
    def residuals(self) -> dict[int, float]:
        """Residual of the terms of each degree in the equation above, degree -> number.

        The result is the largest residual at random points with z'Pz = 1, relative to the largest
        sum of the magnitudes of the products in these terms.
        """
        n = self.states
        rays = Rays(self.rates, self.degree - 1)
        y = directions(n, _RAYS, _SEED)
        z = np.linalg.solve(self.root.T, y.T)
        inputs: list[np.ndarray] = []
        gradients: list[np.ndarray] = []
        residuals = {}
        terms = zip(self.value_terms, self.policy_terms, strict=True)
        for degree, (value, policy) in enumerate(terms, LOWEST):
            gradients.append(self.root @ gradient(y, degree, value).T)
            psi = monomials(n, degree - 1).psi(y) * sizes(n, degree - 1)
            inputs.append(policy @ psi.T)
            total, size = coefficient(self.game, rays, z, inputs, gradients)
            largest = float(size.max())
            residuals[degree] = float(np.abs(total).max()) / largest if largest else 0.0
        return residuals

    @property
    def residual(self) -> float:
        """Largest of `residuals`."""
        return max(self.residuals.values())

    def value_to(self, degree: int) -> ca.Function:
        """Return the CasADi Function z (n,) -> V2 + ... up to a degree."""
        z = ca.SX.sym("z", self.states)
        y = ca.DM(self.root.T) @ z
        terms = enumerate(self.value_terms[: degree + 1 - LOWEST], LOWEST)
        V = sum((polynomial(y, order, term[None]) for order, term in terms), ca.SX(0))
        return ca.Function("V", [z], [V])

    @cached_property
    def V(self) -> ca.Function:
        """CasADi Function z (n,) -> V(z)."""
        return self.value_to(self.degree)

    @cached_property
    def gradient(self) -> ca.Function:
        """CasADi Function z (n,) -> ∂V/∂z (n,)."""
        z = ca.SX.sym("z", self.states)
        return ca.Function("gradient", [z], [ca.densify(ca.gradient(self.V(z), z))])

    @cached_property
    def policy(self) -> ca.Function:
        """CasADi Function z (n,) -> u (m,), a polynomial of degree D - 1."""
        z = ca.SX.sym("z", self.states)
        y = ca.DM(self.root.T) @ z
        terms = enumerate(self.policy_terms, 1)
        u = sum((polynomial(y, order, term) for order, term in terms), ca.SX(0))
        return ca.Function("policy", [z], [u])

    @cached_property
    def disturbance(self) -> ca.Function:
        """CasADi Function z (n,) -> d (k,) = ½ δ⁻² E' ∂V/∂z, the worst disturbance."""
        z = ca.SX.sym("z", self.states)
        d = 0.5 * ca.DM(self.game.E.T / self.game.delta**2) @ self.gradient(z)
        return ca.Function("disturbance", [z], [ca.densify(d)])


def expand(linear: LinearModel, solution: Solution, degree: int) -> Expansion:
    """Return the value and the policies of the nonlinear game about a trim, to a degree.

    linear: linear model at the trim; its model has the nonlinear equations
    solution: exact solution of the game on this linear model
    degree: degree D of the value, 2 to 5; the policies have the degree D - 1

    Raises BadInputError for another degree, too many coefficients, and as `deviation_rates` and
    `Rays` do. Raises NoSolutionError if P is singular, or if rounding dominates the result.
    """
    _check_degree(len(solution.P), degree)
    rates = deviation_rates(linear, solution.game)
    series = Series(solution, Rays(rates, degree - 1), degree)
    for _ in range(LOWEST + 1, degree + 1):
        series.add_degree()
    value = tuple(series.value)
    expansion = Expansion(degree, solution, rates, series.root, value, tuple(series.policy))
    for order, residual in expansion.residuals.items():
        if not residual <= LARGEST_RESIDUAL:
            raise NoSolutionError(
                f"the terms of degree {order} leave a residual of {residual:.2g}, above "
                f"{LARGEST_RESIDUAL:g}, because of rounding; choose a lower order"
            )
    return expansion


def _check_degree(n: int, degree: int) -> None:
    """Raise BadInputError unless a value of n states can have this degree."""
    if degree not in range(LOWEST, HIGHEST + 1):
        raise BadInputError(f"order is {degree}; give a whole number from {LOWEST} to {HIGHEST}")
    count = monomials(n, degree).size
    if count > MOST:
        raise BadInputError(
            f"order {degree} of {n} states has {count} coefficients, more than {MOST}; give a "
            "lower order, or fewer states"
        )
