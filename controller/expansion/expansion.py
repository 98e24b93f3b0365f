"""Value and policies of the nonlinear game about a trim, to a given degree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from controller.critic.critic import monomials_of
from controller.expansion.series import (
    BITS_OF_SERIES,
    balls,
    in_coordinates,
    nominal_size,
    relative_radius,
    root_of,
    series_of_game,
)
from controller.game.basis import TO_DEGREE, Basis, basis as named_basis, monomials
from controller.game.zero_sum import Game
from controller.riccati.balls import ball_matrix, precision
from controller.riccati.gare import Solution
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors, shown
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result, Vector
from trim.linear.linear_model import LinearModel
from trim.linear.nonsmooth import near_switches

if TYPE_CHECKING:
    from controller import Radius


#: Largest rate at a trim, relative to the scale of the rate: the accuracy of saved points.
STEADY = 1e-6


def deviation_rates(linear: LinearModel, game: Game) -> ca.Function:
    """Return the CasADi Function (z, u) -> F(z, u), the rates of the deviations, (n,).

    The states and inputs that the linear model omits stay at the trim. The rates at the trim are
    subtracted: F(0, 0) = 0.

    linear: linear model at the trim
    game: game on this linear model

    Raises BadInputError if the equations contain tables, have a switch at the trim, if a rate is
    not 0 at the operating point, or if the game is in discrete time.
    """
    game.refuse_steps("the nonlinear game")
    model = linear.model
    refuse_nonsmooth(linear)
    rates = rates_about_trim(linear)
    at_trim = rates(0, 0)
    for name, rate in zip(linear.states, np.array(at_trim)[:, 0].tolist(), strict=True):
        if not abs(rate) <= STEADY * model.rate_scale(name):
            raise BadInputError(
                f"{model.title}: the rate of {name} is {rate:.3g} at the operating point; give a "
                "trim at which the states of the linear model are constant"
            )
    z, u = rates.sx_in()
    return ca.Function("rates", [z, u], [ca.densify(rates(z, u) - at_trim)])


def rates_about_trim(linear: LinearModel) -> ca.Function:
    """Return the CasADi Function (z, u) -> z', (n,), of the deviations from the trim.

    The states and inputs that the linear model omits stay at the trim.
    """
    point = linear.point
    model = linear.model
    z = ca.SX.sym("z", len(linear.states))
    u = ca.SX.sym("u", len(linear.inputs))
    deviations = dict(zip(linear.states, ca.vertsplit(z), strict=True))
    deviations |= zip(linear.inputs, ca.vertsplit(u), strict=True)
    states = [value + deviations.get(name, 0.0) for name, value in point.states._asdict().items()]
    inputs = [value + deviations.get(name, 0.0) for name, value in point.inputs._asdict().items()]
    rates, _ = model.layout.expressions((states, inputs, model.p.tolist()), ())  # no outputs
    return ca.Function("plant", [z, u], [rates[model.state_places(linear.states)]])


def refuse_nonsmooth(linear: LinearModel) -> None:
    """Raise BadInputError if the equations call tables, or if one of their switches is at the trim.

    linear: linear model at the trim
    """
    model, point = linear.model, linear.point
    # Indices of the points near a switch: that of the trim, or none.
    points_near, columns = near_switches(model, point.x[None], point.u[None], model.p[None])
    if points_near.size:
        signals = [(*model.states, *model.inputs)[column] for column in columns]
        raise BadInputError(
            f"{model.title}: a table, |.|, min, max or a comparison of {', '.join(signals)} "
            "switches at the trim, where the value has no power series; choose another trim, or "
            "leave out the order"
        )


#: Permitted degrees of a value.
LOWEST = min(TO_DEGREE)
HIGHEST = max(TO_DEGREE)
#: Largest `error` of coefficients that are returned as doubles.
LARGEST_ERROR = 1e-9
#: Share of the cost of a flight by which a value may differ from it in `Expansion.radii`.
PERMITTED_ERROR = 0.05
#: Largest number of coefficients of one degree, whose linear equation is solved in balls.
MOST_COEFFICIENTS = 800


@dataclass(frozen=True, eq=False, repr=False)
class Expansion(Result, Reported):
    """Value V = V2 + ... + VD of a nonlinear game and its policies, as polynomials of z.

    min_u max_d  ∂V/∂z'(F(z, u) + E d) + z'Qz + 2z'Nu + u'Ru - δ² d'd = O(|z|^(D+1))

    This is the Hamilton-Jacobi-Isaacs equation. z is the deviation from the trim and F the
    nonlinear rates. V2 = z'Pz is the value of the linear game. The disturbance is added to the
    rates, with E of the linear game. The inputs are not limited.

    order: degree D of V; the policies have the degree D - 1
    solution: exact solution of the linear game
    rates: CasADi Function (z, u) -> F(z, u)
    root: (n, n), lower triangular, P = root root'. The terms are polynomials of y = root'z.
    value_terms: V2, V3, ..., as weights (M,) of the monomials of y
    policy_terms: u1, u2, ..., as weights (m, M) of the same monomials
    weights: weights W of V = W'ψ(z), (M,), of the monomials in `basis`
    policy_weights: weights of u, (m, M), of all monomials of degree 1 to `order` - 1, sorted by
        degree, and in a degree as by `homogeneous` (z1², z1 z2, z2²)
    nominal: nominal values of the states, (n,)
    error: proved bound of the errors of the terms of V and u before they are rounded, at nominal
        deviations, relative to the largest term there

    >>> import hfa, numpy as np
    >>> linear = hfa.paper.level_model(hfa.aircraft(), np.radians(15.0))
    >>> solution = hfa.solve(hfa.paper.published_game(linear))
    >>> expansion = hfa.expand(linear, solution, order=3)
    >>> type(expansion) is hfa.Expansion, expansion.basis.name
    (True, 'cubic')
    """

    order: int
    solution: Solution
    rates: ca.Function
    root: np.ndarray
    value_terms: tuple[np.ndarray, ...]
    policy_terms: tuple[np.ndarray, ...]
    weights: Vector
    policy_weights: Matrix
    error: float
    nominal: np.ndarray

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
        """Monomials of V, "quadratic", "cubic", "quartic" or "quintic"."""
        return named_basis(TO_DEGREE[self.order], self.states)

    @cached_property
    def radii(self) -> tuple[Radius, ...]:
        """Sets z'Pz <= c in which flights of both players agree with V2, and with V.

        The flights are simulated when the property is first used.
        """
        import controller

        return controller.radii_of(self)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "order": self.order,
            "basis": self.basis.name,
            "W": self.weights,
            "policy_weights": self.policy_weights,
            "radii": self.radii,
            "error": self.error,
        }

    def report(self) -> Report:
        """Return a report of the degree and the radii."""
        import controller

        return controller.expansion_report(self)

    @cached_property
    def V(self) -> ca.Function:
        """CasADi Function z (n,) -> V(z)."""
        return self._polynomial("V", [term[None] for term in self.value_terms], LOWEST)

    @cached_property
    def gradient(self) -> ca.Function:
        """CasADi Function z (n,) -> ∂V/∂z (n,)."""
        z = ca.SX.sym("z", self.states)
        return ca.Function("gradient", [z], [ca.densify(ca.gradient(self.V(z), z))])

    @cached_property
    def policy(self) -> ca.Function:
        """CasADi Function z (n,) -> u (m,), a polynomial of degree D - 1."""
        return self._polynomial("policy", self.policy_terms, 1)

    def _polynomial(self, name: str, terms: Sequence[np.ndarray], lowest: int) -> ca.Function:
        """Return the CasADi Function of z with terms of degree `lowest` and more, given in y."""
        z = ca.SX.sym("z", self.states)
        y = ca.DM(self.root.T) @ z
        parts = [
            ca.DM(term) @ monomials_of(y, monomials(self.states, degree))
            for degree, term in enumerate(terms, lowest)
        ]
        return ca.Function(name, [z], [ca.densify(sum(parts, ca.SX(0)))])

    @cached_property
    def disturbance(self) -> ca.Function:
        """CasADi Function z (n,) -> d (k,) = ½ δ⁻² E' ∂V/∂z, the worst disturbance."""
        z = ca.SX.sym("z", self.states)
        d = 0.5 * ca.DM(self.game.E.T / self.game.delta**2) @ self.gradient(z)
        return ca.Function("disturbance", [z], [ca.densify(d)])


def expand(linear: LinearModel, solution: Solution, order: int) -> Expansion:
    """Return the value and the policies of the nonlinear game about a trim, to a degree.

    The terms follow one degree at a time from the Hamilton-Jacobi-Isaacs equation (Al'brekht's
    method), by a linear equation each, which is solved in balls: all coefficients are proved. V2
    and u1 are those of the solution.

    linear: linear model at the trim; its model has the nonlinear equations
    solution: exact solution of the game on this linear model
    order: degree D of the value, 2 to 5; the policies have the degree D - 1

    Raises BadInputError for another order, for too many coefficients, for equations with tables or
    with a switch or another point without a power series at the trim, and for a game of another
    linear model. Raises NoSolutionError if P is singular, or the coefficients are not decided.
    Source: E. G. Al'brekht, On the optimal stabilization of nonlinear systems, J. Appl. Math. Mech.
    25 (1961); A. J. van der Schaft, IEEE Trans. Automatic Control 37 (1992) 770-784.

    >>> import hfa, numpy as np
    >>> linear = hfa.paper.level_model(hfa.aircraft(), np.radians(15.0))
    >>> solution = hfa.solve(hfa.paper.published_game(linear))
    >>> expansion = hfa.expand(linear, solution, order=3)
    >>> expansion.weights.shape, expansion.error < 1e-12
    ((77,), True)
    """
    n = len(solution.P)
    if order not in range(LOWEST, HIGHEST + 1):
        raise BadInputError(
            f"order is {shown(order)}; give a whole number from {LOWEST} to {HIGHEST}"
        )
    if (count := comb(n + order - 1, order)) > MOST_COEFFICIENTS:
        raise BadInputError(
            f"order {order} of {n} states has {count} coefficients, more than {MOST_COEFFICIENTS}; "
            "give a lower order, or fewer states"
        )
    rates = deviation_rates(linear, solution.game)
    root = root_of(solution.P)
    with prefix_errors(linear.model.title):
        value, policy = series_of_game(solution, rates, order)
    with precision(BITS_OF_SERIES):
        z_of_y = balls(ball_matrix(root.T).inv())
        value_in_y = [in_coordinates(term[None], d, z_of_y) for d, term in enumerate(value, LOWEST)]
        policy_in_y = [in_coordinates(term, d, z_of_y) for d, term in enumerate(policy, 1)]
    nominal = linear.model.nominal(linear.states)
    size = nominal_size(root, nominal)
    error = max(relative_radius(value_in_y, size), relative_radius(policy_in_y, size))
    if not error <= LARGEST_ERROR:
        raise NoSolutionError(
            f"the coefficients to degree {order} are not decided: they are enclosed within "
            f"{error:.2g} of the largest; choose a lower order"
        )
    return Expansion(
        order,
        solution,
        rates,
        root,
        tuple(w[0].astype(float) for w in value_in_y),
        tuple(w.astype(float) for w in policy_in_y),
        weights=np.concatenate(value).astype(float),
        policy_weights=np.hstack(policy).astype(float),
        error=error,
        nominal=nominal,
    )
