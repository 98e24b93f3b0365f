"""Closed loop of a statement in coordinates y, z = T y: enclosed equilibrium, V' and limits.

The set is divided into parts. In each part every input is free or saturated, and every disturbance
is at its lowest or highest value.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from hfa_aircraft.layout import components
from hfa_prove.check.equilibrium import root_offsets
from hfa_prove.fields import Rejected, Terms
from hfa_prove.statements.loop import FREE, LOWEST, Loop
from hfa_prove.statements.plant import SAME_TRIM
from hfa_prove.statements.region import RegionStatement
from hfa_support.errors import BadInputError
from verification.enclosure.ball_function import BallFunction
from verification.enclosure.balls import exact, matrix, norm, symmetric
from verification.enclosure.polynomial import Key, Polynomial, key_of
from verification.enclosure.series import TaylorOnBall

#: Newton steps from a trim in doubles to the precision of the balls.
_STEPS = 8
#: Radius within which the equilibrium is enclosed, in nominal values.
_RADIUS = 1e-25
#: A coefficient and the exponents of its monomial.
_Term = tuple[arb, tuple[int, ...]]


class Equilibrium:
    """Enclosed equilibrium without disturbances, F(x) = f(x, u0 - K (x - x0) + q(x - x0), 0) = 0.

    loop: the loop of a polynomial policy
    stated: moving state -> value near the equilibrium, the trim by default
    x: states, (n,), balls
    u: inputs, (m,), balls strictly within the limits

    Raises Rejected unless an equilibrium near the stated one is proved, with inputs strictly within
    their limits. Raises ZeroDivisionError if the Jacobian is singular.
    """

    def __init__(self, loop: Loop, stated: Mapping[str, float] | None = None) -> None:
        self.loop = loop
        gain = loop.gain
        still = replace(loop, disturbances={})
        self._rates = BallFunction(_function(still, outputs=False), loop.model.name)
        self._slopes = BallFunction(_slopes(loop), loop.model.name)
        self._x0 = [exact(value) for value in loop.trim.values()]
        self._u0 = [exact(value) for value in loop.inputs.values()]
        self._near = [exact(value) for value in (stated or loop.trim).values()]
        self._K = matrix(gain.K)
        self._policy = [_exact_terms(gain.terms.get(name, ())) for name in loop.inputs]
        self.x = self._enclosed()
        self.u = self._inputs(self.x)
        self._check_near()

    def limit_distances(self, name: str) -> tuple[arb | None, arb | None]:
        """Return the distances of an input at the equilibrium from its lower and upper limit.

        A distance is None if there is no such limit.

        name: name of the input
        """
        low, high = self.loop.limits.get(name, (-np.inf, np.inf))
        value = self.u[list(self.loop.inputs).index(name)]
        below = value - exact(low) if np.isfinite(low) else None
        above = exact(high) - value if np.isfinite(high) else None
        return below, above

    def deviations(self, x: Sequence[arb]) -> list[arb]:
        """Return the deviations x - x0 of states x from the trim."""
        return [value - at for value, at in zip(x, self._x0, strict=True)]

    def _inputs(self, x: Sequence[arb]) -> list[arb]:
        """Return the inputs u0 - K (x - x0) + q(x - x0) that the policy commands at states x."""
        away = self.deviations(x)
        linear = (self._K * arb_mat([[value] for value in away])).entries()
        inputs = []
        for at, command, terms in zip(self._u0, linear, self._policy, strict=True):
            inputs.append(at - command + _value(terms, away))
        return inputs

    def _gains(self, x: Sequence[arb]) -> arb_mat:
        """Return the local gain -∂u/∂x = K - ∂q/∂x (m, n) of the policy at states x."""
        away = self.deviations(x)
        slopes = []
        for terms in self._policy:
            slopes.append([_value(_derivative(terms, i), away) for i in range(len(away))])
        return self._K - arb_mat(len(self._u0), len(away), [s for row in slopes for s in row])

    def _enclosed(self) -> list[arb]:
        """Return an enclosure of the states at the only equilibrium near the stated one.

        Raises Rejected if no equilibrium is proved.
        """
        n = len(self._x0)
        x = list(self._near)
        for _ in range(_STEPS):
            step = self._jacobian(x).mid().solve(self._residual(x).mid())
            x = [(value - change).mid() for value, change in zip(x, step.entries(), strict=True)]
        signals = self.loop.model.signals
        radii = [exact(signals[name].nominal) * _RADIUS for name in self.loop.states]
        around = [x[i] + arb(0, 1) * radii[i] for i in range(n)]
        offsets = root_offsets(self._residual(x), self._jacobian(around), radii).entries()
        return [value + offset for value, offset in zip(x, offsets, strict=True)]

    def _residual(self, x: Sequence[arb]) -> arb_mat:
        """Return the residual F(x) as a column."""
        (rates,) = self._rates(x, self._inputs(x), [])
        return arb_mat([[rate] for rate in rates])

    def _jacobian(self, x: Sequence[arb]) -> arb_mat:
        """Return the Jacobian F' = f_x + f_u ∂u/∂x, (n, n)."""
        by_state, by_input = self._slopes(x, self._inputs(x))
        n = len(self._x0)
        m = len(self._u0)
        A = arb_mat(n, n, by_state).transpose()
        B = arb_mat(m, n, by_input).transpose()
        return A - B * self._gains(x)

    def _check_near(self) -> None:
        """Raise Rejected unless the equilibrium is near the stated one, with inputs within limits.

        The states must be within `SAME_TRIM` nominal values of the stated ones, and the inputs
        strictly within their limits.
        """
        signals = self.loop.model.signals
        for name, value, stated in zip(self.loop.states, self.x, self._near, strict=True):
            if not abs(value - stated) <= exact(signals[name].nominal) * SAME_TRIM:
                raise Rejected(
                    f"{name} at the equilibrium differs from the value in the certificate"
                )
        for name in self.loop.inputs:
            for room in self.limit_distances(name):
                if room is not None and not room > 0:
                    raise Rejected(
                        f"{name} is not proved to be within its limits at the equilibrium"
                    )


class RegionLoop:
    """The closed loop of a statement in coordinates y, z = T y.

    z are the deviations of the states from the equilibrium.

    statement: V, rho and the loop
    T: (n, n)
    order: highest degree D of all Taylor polynomials

    Raises Rejected if T is not proved invertible or no equilibrium is proved. Raises BadInputError
    if the equations are not supported.
    """

    def __init__(self, statement: RegionStatement, T: np.ndarray, order: int) -> None:
        self.statement = statement
        self.order = order
        self.equilibrium = Equilibrium(statement.loop, statement.equilibrium)
        self.n = len(T)
        self.T = matrix(T)
        if not _is_invertible(self.T):
            raise Rejected("the matrix T of the coordinates is not proved invertible")
        loop = statement.loop
        self._rates: dict[tuple[str, ...], list[TaylorOnBall]] = {}
        refuse_curved(loop)
        self._function = BallFunction(_function(loop), loop.model.name)

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
    def _commands(self) -> list[Polynomial]:
        """Polynomials in y of u_i - u_e,i before saturation, for each input.

        u = u0 - K (x - x0) + q(x - x0), and u_e is the value of u at the equilibrium.
        """
        loop = self.statement.loop
        away = self.equilibrium.deviations(self.equilibrium.x)
        shifted = [Polynomial.constant(at) + self.deviation(i) for i, at in enumerate(away)]
        substitution = _Substitution(shifted)
        gain = loop.gain
        gains = (matrix(gain.K) * self.T).table() if loop.inputs else []
        commands = []
        for name, row in zip(loop.inputs, gains, strict=True):
            curved = substitution.sum(_exact_terms(gain.terms.get(name, ())))
            commands.append(Polynomial([{}, *curved.parts[1:]]) - Polynomial.linear(row))
        return commands

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

    def command(self, index: int) -> Polynomial:
        """Return u_j - u_e,j of an input j that is free, as a polynomial in y.

        index: index j of the input
        """
        return self._commands[index]

    def reaches(self, name: str) -> tuple[bool, bool]:
        """Return whether an input may reach its lowest and its highest value on the unit ball of y.

        name: name of the input
        """
        index = list(self.statement.loop.inputs).index(name)
        most = sum(self.command(index).norms(), arb(0))
        low, high = self.equilibrium.limit_distances(name)
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
        index = list(self.statement.loop.inputs).index(name)
        low, high = self.equilibrium.limit_distances(name)
        one = Polynomial.constant(arb(1))
        below = None if low is None else one + self.command(index).scaled(1 / low)
        above = None if high is None else one - self.command(index).scaled(1 / high)
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
            self._taylor(Polynomial.constant(at) + self.deviation(i))
            for i, at in enumerate(self.equilibrium.x)
        ]
        u = []
        for index, name in enumerate(self.statement.loop.inputs):
            what = part[name]
            if what == FREE:
                value = Polynomial.constant(self.equilibrium.u[index]) + self.command(index)
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


def _value(terms: Sequence[_Term], z: Sequence[arb]) -> arb:
    """Return the value Σ coefficient z^exponents of a polynomial at z.

    terms: pairs of a coefficient and exponents
    """
    total = arb(0)
    for coefficient, exponents in terms:
        product = coefficient
        for value, power in zip(z, exponents, strict=True):
            for _ in range(power):  # ** of a ball that contains 0 gives nan
                product = product * value
        total += product
    return total


def _without_center(rate: TaylorOnBall) -> TaylorOnBall:
    """Return a rate's Taylor polynomial without its constant term.

    The constant term is 0, because the polynomial is about the equilibrium.
    """
    return TaylorOnBall(rate.order, Polynomial([{}, *rate.polynomial.parts[1:]]), rate.remainder)


def _is_invertible(T: arb_mat) -> bool:
    determinant = T.det()
    return bool(determinant > 0 or determinant < 0)


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


def _slopes(loop: Loop) -> ca.Function:
    """Return the function (x, u) -> Jacobians f_x and f_u of the rates of the moving states."""
    x = ca.SX.sym("x", len(loop.states))
    u = ca.SX.sym("u", len(loop.inputs))
    rates, _ = loop.rates_at(x, u)
    return ca.Function("slopes", [x, u], [ca.densify(ca.jacobian(rates, v)) for v in (x, u)])
