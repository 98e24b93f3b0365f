"""Closed loop of a statement in coordinates y, z = T y: V', rates and limits on the unit ball.

The set is divided into parts. In each part every input is free or saturated, and every disturbance
is at its lowest or highest value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import casadi as ca
import numpy as np
from flint import arb

from hfa_aircraft.layout import components
from hfa_prove.check.equilibrium import check_near, equilibrium_near
from hfa_prove.enclosure.ball_function import BallFunction
from hfa_prove.enclosure.balls import exact, matrix, norm, symmetric
from hfa_prove.enclosure.polynomial import Key, Polynomial, key_of
from hfa_prove.enclosure.series import TaylorOnBall
from hfa_prove.fields import Rejected, Terms
from hfa_prove.statements.loop import FREE, LOWEST, Loop
from hfa_prove.statements.region import RegionStatement
from hfa_support.errors import BadInputError

#: A coefficient and the exponents of its monomial.
_Term = tuple[arb, tuple[int, ...]]


class LoopOnBall:
    """The closed loop of a statement in coordinates y, z = T y.

    z are the deviations of the states from the equilibrium.

    statement: V, rho and the loop
    T: (n, n)
    order: highest degree D of all Taylor polynomials

    Raises Rejected if T is not proved invertible, or no equilibrium near the stated one is proved,
    with inputs strictly within their limits. Raises BadInputError if the equations are not
    supported.
    """

    def __init__(self, statement: RegionStatement, T: np.ndarray, order: int) -> None:
        self.statement = statement
        self.order = order
        loop = statement.loop
        stated = statement.equilibrium
        at = equilibrium_near(loop, np.array(list(stated.values())))
        check_near(at, loop, stated, "the stated one")
        #: Balls of the states at the equilibrium, (n,).
        self.x = at.balls
        self.n = len(T)
        self.T = matrix(T)
        determinant = self.T.det()
        if not (determinant > 0 or determinant < 0):
            raise Rejected("the matrix T of the coordinates is not proved invertible")
        self._rates: dict[tuple[str, ...], list[TaylorOnBall]] = {}
        refuse_curved(loop)
        self._function = BallFunction(_function(loop), loop.model.name)
        for name in loop.inputs:
            for room in self.limit_distances(name):
                if room is not None and not room > 0:
                    raise Rejected(
                        f"{name} is not proved to be within its limits at the equilibrium"
                    )

    def limit_distances(self, name: str) -> tuple[arb | None, arb | None]:
        """Return the distances of an input at the equilibrium from its lower and upper limit.

        A distance is None if there is no such limit.

        name: name of the input
        """
        low, high = self.statement.loop.limits.get(name, (-np.inf, np.inf))
        at = self.inputs[name].constant_term
        below = at - exact(low) if np.isfinite(low) else None
        above = exact(high) - at if np.isfinite(high) else None
        return below, above

    @cached_property
    def _V(self) -> list[_Term]:
        """Terms of the polynomial V / rho in M z."""
        terms = _exact_terms(self.statement.terms)
        return [(factor / exact(self.statement.rho), exponents) for factor, exponents in terms]

    @cached_property
    def _substitution(self) -> _Substitution:
        return _Substitution([Polynomial.linear(row) for row in self.rows])

    @cached_property
    def rows(self) -> list[list[arb]]:
        """Rows of the matrix M T of the coordinates M z in which V is stated, M z = M T y."""
        table: list[list[arb]] = (matrix(self.statement.piece.M) * self.T).table()
        return table

    @cached_property
    def V(self) -> Polynomial:
        """V / rho at z = T y as a polynomial in y."""
        return self._substitution.sum(self._V)

    @cached_property
    def gradient(self) -> list[TaylorOnBall]:
        """Taylor polynomials in y of the components of ∂V/∂z / rho at z = T y."""
        slopes = [self._substitution.sum(_derivative(self._V, k)) for k in range(self.n)]
        gradient = []
        for column in matrix(self.statement.piece.M).transpose().table():
            total = Polynomial([{}])
            for slope, factor in zip(slopes, column, strict=True):
                if factor != 0:
                    total = total + slope.scaled(factor)
            gradient.append(self._taylor(total))
        return gradient

    @cached_property
    def inputs(self) -> Mapping[str, Polynomial]:
        """Input -> u0 - K (x - x0) + q(x - x0), its value before saturation, a polynomial in y."""
        loop = self.statement.loop
        trim = map(exact, loop.trim.values())
        away = [
            Polynomial.constant(at - x0) + self.deviation(i)
            for i, (at, x0) in enumerate(zip(self.x, trim, strict=True))
        ]
        substitution = _Substitution(away)
        inputs = {}
        for (name, u0), row in zip(loop.inputs.items(), loop.gain.K.tolist(), strict=True):
            value = substitution.sum(_exact_terms(loop.gain.terms.get(name, ())))
            for slope, deviation in zip(row, away, strict=True):
                value = value - deviation.scaled(exact(slope))
            inputs[name] = Polynomial.constant(exact(u0)) + value
        return inputs

    def deviation(self, index: int) -> Polynomial:
        """Return the state deviation z_i = Σ T_ij y_j as a polynomial in y.

        index: index i of the state
        """
        return Polynomial.linear(self.T.table()[index])

    def reach(self, index: int) -> arb:
        """Return an upper bound of the state deviation |z_i| on the unit ball of y.

        index: index i of the state
        """
        return norm(self.T.table()[index]).upper()

    def command(self, name: str) -> Polynomial:
        """Return u - u_e of an input before saturation, with u_e at the equilibrium, in y."""
        return self.inputs[name].without_constant()

    def reaches(self, name: str) -> tuple[bool, bool]:
        """Return whether an input may reach its lowest and its highest value on the unit ball of y.

        name: name of the input
        """
        most = sum(self.command(name).norms(), arb(0))
        low, high = self.limit_distances(name)
        return (
            low is not None and not most < low,
            high is not None and not most < high,
        )

    def sides(self, name: str) -> tuple[Polynomial | None, Polynomial | None]:
        """Return polynomials in y for the lower and the upper limit of an input.

        - lower limit: 1 + command / room
        - upper limit: 1 - command / room

        A polynomial is positive where the command does not reach the limit, and None if there is no
        such limit. The command is the deviation of the input from the equilibrium before
        saturation. The room is the distance of the limit from the equilibrium.

        name: name of the input
        """
        low, high = self.limit_distances(name)
        one = Polynomial.constant(arb(1))
        below = None if low is None else one + self.command(name).scaled(1 / low)
        above = None if high is None else one - self.command(name).scaled(1 / high)
        return below, above

    def decrease(self, part: Mapping[str, str]) -> TaylorOnBall:
        """Return the Taylor polynomial of -V' / rho on a part of the set.

        part: input -> `FREE`, `LOWEST` or `HIGHEST`, and disturbance -> `LOWEST` or `HIGHEST`

        Raises Rejected if an output is not proved to stay within its limits, and Undecided if the
        equations are not proved to be smooth on the unit ball.
        """
        total = self._taylor(Polynomial([{}]))
        for slope, rate in zip(self.gradient, self.rates(part), strict=True):
            total = total - slope * rate
        return total

    def rates(self, part: Mapping[str, str]) -> list[TaylorOnBall]:
        """Return the Taylor polynomials of z' on a part of the set.

        part: input -> `FREE`, `LOWEST` or `HIGHEST`, and disturbance -> `LOWEST` or `HIGHEST`

        Raises Rejected if an output is not proved to stay within its limits for all disturbances,
        and Undecided if the equations are not proved to be smooth on the unit ball.
        """
        key = tuple(part.values())
        if key not in self._rates:
            sizes = {name: exact(size) for name, size in self.statement.loop.disturbances.items()}
            ends = [-size if part[name] == LOWEST else size for name, size in sizes.items()]
            rates, outputs = self._run(part, ends)
            if sizes:
                # Comparisons in the equations are decided for all w between the ends too.
                _, outputs = self._run(part, [symmetric(size) for size in sizes.values()])
            self._check_outputs(outputs)
            if all(what == FREE for what in part.values()):
                rates = [_without_center(rate) for rate in rates]
            self._rates[key] = rates
        return self._rates[key]

    def _run(
        self, part: Mapping[str, str], disturbances: Sequence[arb]
    ) -> tuple[list[TaylorOnBall], list[TaylorOnBall]]:
        """Return Taylor polynomials of the rates and of the outputs with limits on the unit ball.

        part: input -> `FREE`, `LOWEST` or `HIGHEST`
        disturbances: ball of each disturbance
        """
        x = [
            self._taylor(Polynomial.constant(at) + self.deviation(i)) for i, at in enumerate(self.x)
        ]
        u = []
        for name in self.statement.loop.inputs:
            what = part[name]
            if what == FREE:
                value = self.inputs[name]
            else:
                low, high = self.statement.loop.limits[name]
                value = Polynomial.constant(exact(low if what == LOWEST else high))
            u.append(self._taylor(value))
        results = self._function(x, u, disturbances)
        zero = self._taylor(Polynomial([{}]))
        rates, outputs = ([value + zero for value in values] for values in results)
        return rates, outputs

    def _check_outputs(self, values: Sequence[TaylorOnBall]) -> None:
        """Raise Rejected unless each output is proved within its limits on the unit ball of y.

        values: Taylor polynomials of the outputs with limits
        """
        for name, value in zip(self.statement.loop.limited_outputs, values, strict=True):
            low, high = self.statement.loop.limits[name]
            ball = value.range()
            if not ((low == -np.inf or ball >= exact(low)) and (high == np.inf or ball <= high)):
                raise Rejected(f"{name} is not proved to stay within its limits in the set")

    def _taylor(self, polynomial: Polynomial) -> TaylorOnBall:
        return TaylorOnBall(self.order, polynomial, arb(0))


class _Substitution:
    """Substitution of polynomials in y for the variables z of a polynomial.

    variables: each z_i as a polynomial in y
    """

    def __init__(self, variables: Sequence[Polynomial]) -> None:
        self._variables = variables
        self._known: dict[Key, Polynomial] = {0: Polynomial.constant(arb(1))}

    def sum(self, terms: Sequence[_Term]) -> Polynomial:
        """Return the polynomial Σ coefficient z^exponents in z as a polynomial in y.

        terms: pairs of a coefficient and exponents
        """
        total = Polynomial([{}])
        for coefficient, exponents in terms:
            total += self(exponents).scaled(coefficient)
        return total

    def __call__(self, exponents: Sequence[int]) -> Polynomial:
        """Return the monomial z^exponents as a polynomial in y."""
        key = key_of(exponents)
        if key not in self._known:
            last = max(i for i, power in enumerate(exponents) if power)
            lowered = [power - (i == last) for i, power in enumerate(exponents)]
            self._known[key] = self(lowered).times(self._variables[last])
        return self._known[key]


def _exact_terms(terms: Terms) -> list[_Term]:
    """Return the terms of a statement with their coefficients as balls of radius 0."""
    return [(exact(coefficient), exponents) for coefficient, exponents in terms]


def _derivative(terms: Sequence[_Term], index: int) -> list[_Term]:
    """Return the terms of the derivative of a polynomial with respect to z_index."""
    slopes = []
    for coefficient, exponents in terms:
        power = exponents[index]
        if power:
            lowered = (*exponents[:index], power - 1, *exponents[index + 1 :])
            slopes.append((coefficient * power, lowered))
    return slopes


def _without_center(rate: TaylorOnBall) -> TaylorOnBall:
    """Return a rate's Taylor polynomial without its constant term.

    The constant term is 0, because the polynomial is about the equilibrium.
    """
    return TaylorOnBall(rate.order, rate.polynomial.without_constant(), rate.remainder)


def refuse_curved(loop: Loop) -> None:
    """Raise BadInputError if a rate is not affine in the disturbances.

    Otherwise the worst value of a disturbance might not be an end of its range.
    """
    if not loop.disturbances:
        return
    function = _function(loop, outputs=False)
    symbols = function.sx_in()
    curved = ca.which_depends(function(*symbols), symbols[2], 2)
    for name, is_curved in zip(loop.disturbances, curved, strict=True):
        if is_curved:
            raise BadInputError(
                f"{loop.model.name}: the rates are not affine in {name}; such disturbances are not"
                " supported"
            )


def _function(loop: Loop, outputs: bool = True) -> ca.Function:
    """Return the function (x, u, w) -> rates of the moving states, and outputs with limits.

    w are the disturbances of the loop.

    outputs: whether the function returns the outputs
    """
    x = ca.SX.sym("x", len(loop.states))
    u = ca.SX.sym("u", len(loop.inputs))
    w = ca.SX.sym("w", len(loop.disturbances))
    acting = dict(zip(loop.disturbances, components(w), strict=True))
    every = [acting.get(name, 0.0) for name in loop.model.disturbances] if acting else None
    rates, limited = loop.rates_at(x, u, every)
    return ca.Function("rates", [x, u, w], [rates, limited] if outputs else [rates])
