"""Checker of the value of a nonlinear game about a trim, coefficient by coefficient.

The equations are evaluated on rays z = t a, as power series in t with balls as coefficients. The
directions are the lattice points a with nonnegative entries of the sum D, in units of each state. A
homogeneous polynomial of at most degree D that is zero on all of them is zero (principal lattice;
Chung and Yao, SIAM J. Numer. Anal. 14, 1977).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from flint import arb, arb_mat, arb_series

from hfa_prove.check.game import riccati_S
from hfa_prove.check.modes import modes_right_of
from hfa_prove.enclosure.ball_function import BallFunction
from hfa_prove.enclosure.balls import lowest_sign, matrix, symmetric
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.value import ValueStatement, ValueWitness, powers_of

#: Largest rate at the trim, relative to the scale of the rate.
_STEADY = 1e-6
#: Half-widths of the box about the trim on which the equations must be smooth, in nominal values.
_NEAR = 1e-9
_ZERO = arb(0)
#: Factor and coefficients of t^0, t^1, ... of two polynomials.
_Product = tuple[float | arb, list[arb], list[arb]]


def check_value(statement: ValueStatement, witness: ValueWitness) -> int:
    """Prove that V and u satisfy the equation of a nonlinear game, and return the number of rays.

    Raises Rejected if the equations may switch near the trim or the rates are not zero at the trim,
    if a coefficient exceeds the residual, if V is not positive definite, or if A - S P is not
    proved Hurwitz. Raises Undecided if the equations are not proved to be defined at the trim.
    """
    if lowest_sign(statement.P) <= 0:
        raise Rejected("the quadratic part of V is not positive definite")
    equation = ValueEquation(statement)
    equation.check_trim()
    equation.check_residual(arb(statement.residual))
    loop = equation.A - riccati_S(statement.weights, equation.B) * matrix(statement.P)
    if modes_right_of(loop, witness.loop) != 0:
        raise Rejected("A - S P is not proved Hurwitz")
    return len(equation.directions)


@dataclass(frozen=True, eq=False)
class ValueEquation:
    """The equation of a statement along rays from the trim."""

    statement: ValueStatement

    @cached_property
    def _equations(self) -> BallFunction:
        """Function (x, u, l) -> rates f (n,) and ∂(l'f)/∂u (m,)."""
        plant = self.statement.plant
        x = ca.SX.sym("x", len(plant.states))
        u = ca.SX.sym("u", len(plant.inputs))
        gradient = ca.SX.sym("l", len(plant.states))
        rates, _ = plant.rates_at(x, u)
        slopes = ca.densify(ca.gradient(ca.dot(rates, gradient), u))
        return BallFunction(ca.Function("rates", [x, u, gradient], [rates, slopes]))

    @cached_property
    def _trim(self) -> tuple[list[arb], list[arb]]:
        """Trim values of the moving states and of the inputs."""
        plant = self.statement.plant
        return [arb(x) for x in plant.trim.values()], [arb(u) for u in plant.inputs.values()]

    @cached_property
    def _rates_at_trim(self) -> list[arb]:
        x, u = self._trim
        return self._equations(x, u, [_ZERO] * len(x))[0]

    def check_trim(self) -> None:
        """Raise Rejected unless the equations are smooth near the trim and the rates are small.

        On a box around the trim, no comparison may switch, which raises Undecided.
        """
        plant = self.statement.plant
        x, u = self._trim
        near = [symmetric(_NEAR * size) for size in plant.nominal.tolist()]
        states = [value + ball for value, ball in zip(x, near[: len(x)], strict=True)]
        inputs = [value + ball for value, ball in zip(u, near[len(x) :], strict=True)]
        self._equations(states, inputs, [arb(1)] * len(x))
        for name, rate in zip(plant.states, self._rates_at_trim, strict=True):
            if not abs(rate) <= _STEADY * plant.model.rate_scale(name):
                raise Rejected(f"the rate of {name} is not 0 at the trim")

    @cached_property
    def directions(self) -> list[list[arb]]:
        """Directions of the rays: lattice points times the size of each state in z'Pz <= 1."""
        statement = self.statement
        n = len(statement.plant.states)
        sizes = np.sqrt(np.abs(np.diag(np.linalg.inv(statement.P))))
        if not np.all(np.isfinite(sizes) & (sizes > 0.0)):
            raise Rejected("the quadratic part of V is singular in double precision")
        widths = [arb(size) for size in sizes.tolist()]
        order = statement.order
        points = powers_of(n, [order])
        return [[width * k / order for width, k in zip(widths, a, strict=True)] for a in points]

    def residual(self) -> arb:
        """Return a ball whose upper end bounds every coefficient, relative to its terms."""
        worst = _ZERO
        for totals, sizes in self._coefficients():
            largest = max((size.abs_lower() for size in sizes), default=_ZERO)
            for total in totals:
                bound = total.abs_upper()
                if bound > 0:
                    worst = worst.max(bound / largest)
        return worst

    def check_residual(self, claimed: arb) -> None:
        """Raise Rejected unless every coefficient is at most the claimed share of its terms."""
        if not self.residual() <= claimed:
            raise Rejected("V and u do not satisfy the equation within the stated residual")

    def _coefficients(self) -> list[tuple[list[arb], list[arb]]]:
        """Return coefficients and sizes of their terms on all rays.

        There is an item for each degree of the equation, and for each degree and input of its
        derivative with respect to u.
        """
        rays = [self._on_ray(direction) for direction in self.directions]
        return [
            ([ray[index][0] for ray in rays], [ray[index][1] for ray in rays])
            for index in range(len(rays[0]))
        ]

    def _on_ray(self, a: list[arb]) -> list[tuple[arb, arb]]:
        """Return the coefficients along the ray z = t a, each with the sum of its magnitudes."""
        statement = self.statement
        weights = statement.weights
        order = statement.order
        n = len(a)
        gradient, policy = self._terms(a)
        x0, u0 = self._trim
        prec = order + 1
        x = [arb_series([x0[i], a[i]], prec) for i in range(n)]
        u = [arb_series([value, *terms], prec) for value, terms in zip(u0, policy, strict=True)]
        slopes = [arb_series([_ZERO, *terms], prec) for terms in gradient]
        f, g = self._equations(x, u, slopes)
        # The rates at the trim are subtracted, so the constant terms are exactly 0.
        rates = [[_ZERO, *(_entry(rate, k) for k in range(1, prec))] for rate in f]
        lists = [[_ZERO, *terms] for terms in gradient]
        pushed = [_combined(column, lists) for column in weights.E.T.tolist()]
        pairs: list[_Product] = [(1.0, rates[i], lists[i]) for i in range(n)]
        z = [[_ZERO, a[i]] for i in range(n)]
        pairs += [(weights.Q[i, j], z[i], z[j]) for i in range(n) for j in range(n)]
        v = [[_ZERO, *terms] for terms in policy]
        m = len(v)
        pairs += [(weights.R[i, j], v[i], v[j]) for i in range(m) for j in range(m)]
        quarter = 1 / (4 * arb(weights.delta) ** 2)
        pairs += [(quarter, row, row) for row in pushed]
        found = [_product(pairs, degree) for degree in range(2, order + 1)]
        for j in range(m):
            effort = _combined((2.0 * weights.R[j]).tolist(), v)
            for degree in range(1, order):
                terms = (_entry(g[j], degree), _entry(effort, degree))
                found.append((sum(terms, _ZERO), sum(map(abs, terms), _ZERO)))
        return found

    def _terms(self, a: list[arb]) -> tuple[list[list[arb]], list[list[arb]]]:
        """Return the coefficients of t, t², ... of ∂V/∂z, n lists, and of u, m lists."""
        statement = self.statement
        n = len(a)
        order = statement.order
        powers = [[arb(1)] for _ in range(n)]
        for row, value in zip(powers, a, strict=True):
            for _ in range(order):
                row.append(row[-1] * value)

        def monomial(exponents: Sequence[int]) -> arb:
            product = arb(1)
            for row, power in zip(powers, exponents, strict=True):
                if power:
                    product *= row[power]
            return product

        gradient = [[_ZERO] * (order - 1) for _ in range(n)]
        listed = powers_of(n, range(2, order + 1))
        for weight, exponents in zip(statement.V.tolist(), listed, strict=True):
            degree = sum(exponents)
            for i, power in enumerate(exponents):
                if power:
                    lowered = [p - (k == i) for k, p in enumerate(exponents)]
                    gradient[i][degree - 2] += arb(weight) * power * monomial(lowered)
        policy = [[_ZERO] * (order - 1) for _ in range(len(statement.u))]
        for exponents, column in zip(
            powers_of(n, range(1, order)), statement.u.T.tolist(), strict=True
        ):
            value = monomial(exponents)
            for row, weight in zip(policy, column, strict=True):
                row[sum(exponents) - 1] += arb(weight) * value
        return gradient, policy

    @cached_property
    def _linear(self) -> list[list[arb]]:
        """Derivatives of the rates with respect to each state and input at the trim, columns."""
        x0, u0 = self._trim
        n = len(x0)
        columns = []
        for moved in range(n + len(u0)):
            both = [
                arb_series([value, 1 if index == moved else 0], 2)
                for index, value in enumerate([*x0, *u0])
            ]
            f, _ = self._equations(both[:n], both[n:], [arb_series([0], 2)] * n)
            columns.append([_entry(rate, 1) for rate in f])
        return columns

    @property
    def A(self) -> TaylorModel:
        """Matrix A of the linear model at the trim."""
        return TaylorModel(_of_columns(self._linear[: len(self._trim[0])]))

    @property
    def B(self) -> TaylorModel:
        """Matrix B of the linear model at the trim."""
        return TaylorModel(_of_columns(self._linear[len(self._trim[0]) :]))


def _of_columns(columns: list[list[arb]]) -> arb_mat:
    return arb_mat([list(row) for row in zip(*columns, strict=True)])


def _entry(series: Any, degree: int) -> arb:
    """Return a coefficient of a series, a list of coefficients, or a constant."""
    if isinstance(series, arb):
        return _ZERO
    if isinstance(series, list):
        return series[degree] if degree < len(series) else _ZERO
    return series[degree]


def _combined(factors: Sequence[float], rows: list[list[arb]]) -> list[arb]:
    """Return the sum of rows times factors."""
    pairs = zip(factors, rows, strict=True)
    scaled = [[arb(factor) * value for value in row] for factor, row in pairs]
    return [sum(values, _ZERO) for values in zip(*scaled, strict=True)]


def _product(pairs: list[_Product], degree: int) -> tuple[arb, arb]:
    """Return the coefficient of t^degree of Σ c p(t) q(t), and the sum of its magnitudes."""
    total = _ZERO
    size = _ZERO
    for factor, p, q in pairs:
        if factor == 0:
            continue
        for k in range(1, degree):
            term = factor * _entry(p, k) * _entry(q, degree - k)
            total += term
            size += abs(term)
    return total, size
