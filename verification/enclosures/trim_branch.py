"""The branch of trims over a box of dihedrals, and the linear model along it, enclosed."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from flint import arb, arb_mat, arb_series

from hfa_model.aircraft import Aircraft, compiled_dynamics
from hfa_model.vectors import INPUTS, LINEAR_ROWS, STATES
from hfa_support.errors import BadInputError
from trim.point.condition import BALANCED, LEVEL_FLIGHT, TrimCondition, describe
from trim.point.solve import find_operating_point
from verification.arithmetic import flint_or_refusal
from verification.arithmetic.ball_function import BallFunction, Undecided
from verification.arithmetic.balls import as_read, doubles, exact, inside, matrix, symmetric
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.dihedral_box import ORDER, DihedralBox, dihedral_series, radians

#: At such a flight θ' = q and η' = η' are 0 already; what the unknowns of the trim move is left.
EQUATIONS = tuple(STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate"))


@dataclass(frozen=True)
class Family:
    """Steady flights that differ in their dihedral alone.

    aircraft: its parameters as doubles. flights: what is imposed and left free. spread: a half width for each
    parameter, (18,). decimals: every parameter and setting is a ball that also holds the decimal it was read from;
    else it is the double exactly.
    """

    aircraft: Aircraft
    flights: TrimCondition = LEVEL_FLIGHT
    spread: tuple[float, ...] | None = None
    decimals: bool = True

    def condition(self, degrees: float) -> TrimCondition:
        """The trim at a dihedral, degrees."""
        return self.flights.at(math.radians(degrees))

    def check(self, low: float, high: float) -> None:
        """BadInputError unless the trims of the interval, degrees, are of the kind that is proved."""
        first, last = (self.condition(end) for end in (low, high))
        for condition in (first, last):
            check_pitch(condition)
        still = all(first.imposed.get(name) == 0.0 for name in ("pitch_rate", "dihedral_rate"))
        still = still and dict(first.rates or {}) == dict.fromkeys(BALANCED, 0.0)
        if not (still and len(first.free) == len(EQUATIONS) and "dihedral" in first.imposed):
            raise BadInputError(
                f"a proof takes trims at a given dihedral, all rates 0, with {len(EQUATIONS)} unknowns; "
                f"here free are {', '.join(first.free)}: change --hold and --free"
            )
        for name in self.flights.tables:
            raise BadInputError(f"{name} changes with the dihedral in this condition; --hold it at one value")


def limits_with_pitch(condition: TrimCondition, name: str) -> tuple[float, float]:
    """Lowest and highest value of a variable; of alpha and gamma what the limits of pitch = alpha + gamma leave."""
    lowest, highest = condition.limits_of(name)
    if name not in ("alpha", "gamma"):
        return lowest, highest
    other = "gamma" if name == "alpha" else "alpha"
    least, most = (condition.imposed[other],) * 2 if other in condition.imposed else condition.limits_of(other)
    pitch = condition.limits_of("pitch")
    return max(lowest, pitch[0] - most), min(highest, pitch[1] - least)


def check_pitch(condition: TrimCondition) -> None:
    """BadInputError when pitch = alpha + gamma lies beyond its limits, or they leave no alpha or gamma."""
    if "alpha" in condition.imposed and "gamma" in condition.imposed:
        pitch, (lowest, highest) = condition.imposed["alpha"] + condition.imposed["gamma"], condition.limits_of("pitch")
        if not lowest <= pitch <= highest:
            ends = f"{describe('pitch', lowest)} and {describe('pitch', highest)}"
            raise BadInputError(f"pitch is {describe('pitch', pitch)}; it must lie between {ends}")
    for name in condition.free:
        lowest, highest = limits_with_pitch(condition, name)
        if not lowest < highest:
            raise BadInputError(f"the limits of pitch, alpha and gamma leave no {name}; widen one of them")


#: Attempts to widen a box of unknowns until Krawczyk's operator maps it into itself.
_ATTEMPTS = 6


@dataclass(frozen=True, eq=False)
class TrimEquations:
    """F(w, η) = 0: the balanced rates; w: the unknowns `free`, the rest is imposed.

    rates, jacobians: of the model. parameters: balls, or one of them a series.
    """

    rates: BallFunction
    jacobians: BallFunction
    imposed: dict[str, arb]
    free: tuple[str, ...]
    parameters: list[Any]

    def arguments(
        self, dihedral: Any, series: Sequence[Sequence[arb]], length: int
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """States, inputs and parameters; dihedral in rad, the unknowns as coefficients."""
        values: dict[str, Any] = self.imposed | {"dihedral": dihedral}
        for name, own in zip(self.free, series, strict=True):
            values[name] = arb_series(list(own[:length]), prec=length)
        values["pitch"] = values["alpha"] + values["gamma"]
        return [values[name] for name in STATES], [values[name] for name in INPUTS], self.parameters

    def residual(self, dihedral: Any, series: Sequence[Sequence[arb]], length: int) -> list[list[arb]]:
        """Coefficients of F, a list for each equation."""
        rates = self.rates(*self.arguments(dihedral, series, length))[0]
        return [coefficients(rates[index], length) for index in EQUATIONS]

    def derivative(self, degrees: arb, values: list[arb]) -> arb_mat:
        """F_w at constant arguments."""
        _, A, B = self.jacobians(*self.arguments(radians(degrees), [[value] for value in values], 1))
        n, flat = len(STATES), [coefficients(each, 1)[0] for each in [*A, *B]]
        columns = {name: flat[n * j : n * j + n] for j, name in enumerate(STATES + INPUTS)}
        # The pitch angle is no variable of a trim: it is alpha + gamma.
        columns["alpha"] = [a + b for a, b in zip(columns["alpha"], columns["pitch"], strict=True)]
        columns["gamma"] = columns["pitch"]
        return arb_mat([[columns[name][row] for name in self.free] for row in EQUATIONS])

    def inverse(self, degrees: arb, values: list[arb]) -> arb_mat:
        """A matrix of balls that holds the inverse of F_w."""
        derivative = self.derivative(degrees, values)
        rough = matrix(np.linalg.inv(doubles(derivative)))
        try:
            return (rough * derivative).inv() * rough
        except ZeroDivisionError as error:
            raise Undecided("the derivative of the trim equations may be singular on this box") from error

    def newton(self, degrees: arb, values: list[arb]) -> tuple[list[arb], arb_mat]:
        """C F(w, η) and C, the inverse of F_w rounded to doubles."""
        inverse = matrix(np.linalg.inv(doubles(self.derivative(degrees.mid(), values))))
        residual = self.residual(radians(degrees), [[value] for value in values], 1)
        return (inverse * arb_mat([[series[0]] for series in residual])).entries(), inverse

    def contracted(self, degrees: arb, middle: list[arb], widths: list[arb]) -> list[arb]:
        """Balls about `middle` that Krawczyk's operator maps into their interior, as it leaves them."""
        step, inverse = self.newton(degrees, middle)
        identity = matrix(np.eye(len(middle)))
        for _ in range(_ATTEMPTS):
            offsets = [symmetric(1.2 * width) for width in widths]
            candidate = [value + offset for value, offset in zip(middle, offsets, strict=True)]
            jacobian = self.derivative(degrees, candidate)
            image = (identity - inverse * jacobian) * arb_mat([[offset] for offset in offsets])
            mapped = [row - change for change, row in zip(step, image.entries(), strict=True)]
            if inside(mapped, offsets):
                return [value + offset for value, offset in zip(middle, mapped, strict=True)]
            widths = [abs(before.union(after)).upper() for before, after in zip(offsets, mapped, strict=True)]
        raise Undecided("Krawczyk's operator does not map a box of unknowns into itself")

    def branch(self, degrees: arb, start: list[arb], length: int) -> list[list[arb]]:
        """Taylor coefficients w_0 .. in the dihedral, degrees, of the branch through `start`; a list an unknown."""
        series, solved = [[value] for value in start], self.inverse(degrees, start)
        for j in range(1, length):
            residual = self.residual(dihedral_series(degrees, j + 1), series, j + 1)
            change = solved * arb_mat([[each[j]] for each in residual])
            for own, value in zip(series, change.entries(), strict=True):
                own.append(-value)
        return series


def coefficients(value: Any, length: int) -> list[arb]:
    """Of a series or a ball, `length` of them."""
    if isinstance(value, arb):
        return [value] + [arb(0)] * (length - 1)
    return [value[index] for index in range(length)]


_COLUMNS = range(len(INPUTS))
#: Least half width of a box of unknowns: what is known exactly still needs an interior.
_TINY = 1e-30
#: Widest box, deg, with errors of the parameters, whose derivatives are enclosed to first order.
_WIDEST_WITH_ERRORS = 0.25
#: Half width, relative, of the first box of unknowns for all parameters.
_FIRST = 1e-4


class Errors(NamedTuple):
    """Derivatives with respect to one parameter, in its half widths, everywhere on a box and for all parameters.

    A: (6, 6), B: (6, 5), unknowns: (4, 1).
    """

    A: arb_mat
    B: arb_mat
    unknowns: arb_mat


@dataclass(frozen=True)
class ModelForms:
    """Over a box: inputs U0(η), (5, 1), and A(η), (6, 6), B(η), (6, 5), of the six states of the linear model.

    unknowns: the free variables of the trim, (4, 1). next_unknowns: their third Taylor coefficient at the middle, times
    radius³: how large the remainder about is. Of the unknowns, A and B the parameters with a half width are the errors.
    cubic: the coefficients of s³ of A and B anywhere on the box, which the remainder takes with both signs.
    """

    box: DihedralBox
    unknowns: TaylorModel
    next_unknowns: list[arb]
    inputs: TaylorModel
    A: TaylorModel
    B: TaylorModel
    cubic: tuple[arb_mat, arb_mat]


class TrimBranch:
    """Encloses trims and linear models of a family of flights.

    On a box, Krawczyk's operator K(W) = ŵ - C F(ŵ, η) + (I - C F_w(W, η)) (W - ŵ) maps W into its own interior: for
    every η of the box there is one and only one w(η) in W (Krawczyk 1969; Moore 1977), and it is smooth. Its Taylor
    coefficients follow one after the other from F_w w_j = -[F(Σ_{i<j} w_i τ^i, η + τ)]_j.
    """

    def __init__(self, family: Family) -> None:
        flint_or_refusal()
        self.family = family
        condition = family.condition(0.0)
        self.free = condition.free
        self.limits = {name: limits_with_pitch(condition, name) for name in dict.fromkeys((*INPUTS, *condition.free))}
        ball = as_read if family.decimals else exact
        functions = compiled_dynamics(family.aircraft.variant)
        self._known = TrimEquations(
            BallFunction(functions.rates),
            BallFunction(functions.jacobians),
            {name: ball(value) for name, value in condition.imposed.items()},
            condition.free,
            [ball(value) for value in family.aircraft.parameters],
        )
        spread = [exact(width) for width in family.spread or ()]
        self._uncertain = [(k, width) for k, width in enumerate(spread) if width > 0]
        everything = list(self._known.parameters)
        for k, width in self._uncertain:
            everything[k] += symmetric(width)
        self._all = replace(self._known, parameters=everything)

    def forms(self, box: DihedralBox) -> ModelForms:
        """The model over a box. Undecided when the box is too wide, TrimError when its middle has no trim."""
        if self._uncertain and box.radius > _WIDEST_WITH_ERRORS / 2:
            raise Undecided("the errors of the parameters are enclosed on narrower boxes only")
        at_middle = self._known.branch(box.middle, self.trim_at(float(box.middle)), ORDER + 1)
        everywhere = self._everywhere(box, at_middle)
        wide = self._known.branch(box.degrees, everywhere, ORDER + 1)
        (u, A, B), (wide_u, wide_A, wide_B) = (
            self._model(self._known, dihedral_series(degrees, length), series, length)
            for degrees, series, length in ((box.middle, at_middle, ORDER), (box.degrees, wide, ORDER + 1))
        )
        errors = tuple(self._errors(box, everywhere)) if self._uncertain else ()
        return ModelForms(
            box,
            _form(box, at_middle, wide, range(len(wide)), [0], [each.unknowns for each in errors]),
            [series[ORDER] * box.radius**ORDER for series in at_middle],
            _form(box, u, wide_u, _COLUMNS, [0]),
            _form(box, A, wide_A, LINEAR_ROWS, LINEAR_ROWS, [each.A for each in errors]),
            _form(box, B, wide_B, LINEAR_ROWS, _COLUMNS, [each.B for each in errors]),
            (
                _matrix(wide_A, ORDER, LINEAR_ROWS, LINEAR_ROWS) * box.radius**ORDER,
                _matrix(wide_B, ORDER, LINEAR_ROWS, _COLUMNS) * box.radius**ORDER,
            ),
        )

    def model_at(self, degrees: float) -> tuple[arb_mat, arb_mat, arb_mat]:
        """A (6, 6), B (6, 5) and the inputs (5, 1) at one dihedral, degrees, in balls."""
        point = [[value] for value in self.trim_at(degrees)]
        u, A, B = self._model(self._known, radians(exact(degrees)), point, 1)
        return (
            _matrix(A, 0, LINEAR_ROWS, LINEAR_ROWS),
            _matrix(B, 0, LINEAR_ROWS, _COLUMNS),
            _matrix(u, 0, _COLUMNS, [0]),
        )

    def trim_at(self, degrees: float) -> list[arb]:
        """The unknowns at one dihedral, degrees, in balls: Newton's method on midpoints, then Krawczyk."""
        at = exact(degrees)
        found = find_operating_point(self.family.aircraft, self.family.condition(degrees))
        values = found.states._asdict() | found.inputs._asdict()
        values["gamma"] = values["pitch"] - values["alpha"]
        middle = [exact(values[name]) for name in self.free]
        for _ in range(2):
            step, _ = self._known.newton(at, middle)
            middle = [(value - change).mid() for value, change in zip(middle, step, strict=True)]
        step, _ = self._known.newton(at, middle)
        return self._known.contracted(at, middle, [abs(change).upper() + exact(_TINY) for change in step])

    def beyond_limits(self, forms: ModelForms) -> str | None:
        """What may leave its limits somewhere on the box; None when all is proved to stay within."""
        values = dict(zip(INPUTS, forms.inputs.range().entries(), strict=True))
        values |= zip(self.free, forms.unknowns.range().entries(), strict=True)
        for name, value in values.items():
            low, high = self.limits[name]
            if not (exact(low) <= value <= exact(high)):
                return name
        return None

    def _everywhere(self, box: DihedralBox, at_middle: list[list[arb]]) -> list[arb]:
        """A ball for each unknown that holds the branch on the whole box: w(η) = w(η_0) + w'(ξ) (η - η_0)."""
        start = [series[0] for series in at_middle]
        widths = [series[0].rad() + abs(series[1]).upper() * box.radius + exact(_TINY) for series in at_middle]
        found = self._around(self._known, box, start, widths)
        slopes = self._known.branch(box.degrees, found, 2)
        tau = symmetric(box.radius)
        return [value + tau * series[1] for value, series in zip(start, slopes, strict=True)]

    @staticmethod
    def _around(equations: TrimEquations, box: DihedralBox, start: list[arb], widths: list[arb]) -> list[arb]:
        """Krawczyk's box about what is known of a part of it."""
        found = equations.contracted(box.degrees, [value.mid() for value in start], widths)
        if not all(ball.contains(value) for ball, value in zip(found, start, strict=True)):
            raise Undecided("the trim at the middle of the box is not the one found around it")
        return found

    def _errors(self, box: DihedralBox, known: list[arb]) -> Iterator[Errors]:
        """What each parameter does; `known`: the unknowns on the box without errors.

        w(η, p) = w(η, p_0) + Σ_k ∂w/∂p_k (p_k - p_0k), with the derivatives -F_w⁻¹ F_p anywhere between.
        """
        widths = [value.rad() * 2 + abs(value).upper() * _FIRST for value in known]
        found = self._around(self._all, box, known, widths)
        slopes: list[arb_mat] = []
        for _ in range(2):  # the second time with the narrower unknowns that the first time gives
            inverse, constant = self._all.inverse(box.degrees, found), [[value] for value in found]
            slopes = []
            for k, width in self._uncertain:
                residual = self._moved(k, width).residual(radians(box.degrees), constant, 2)
                slopes.append(-inverse * arb_mat([[each[1]] for each in residual]))
            moves = [sum((symmetric(each[i, 0]) for each in slopes), exact(0.0)) for i in range(len(found))]
            found = [value + move for value, move in zip(known, moves, strict=True)]
        for (k, width), slope in zip(self._uncertain, slopes, strict=True):
            series = [[value, rise] for value, rise in zip(found, slope.entries(), strict=True)]
            _, A, B = self._model(self._moved(k, width), radians(box.degrees), series, 2)
            yield Errors(_matrix(A, 1, LINEAR_ROWS, LINEAR_ROWS), _matrix(B, 1, LINEAR_ROWS, _COLUMNS), slope)

    def _moved(self, k: int, width: arb) -> TrimEquations:
        """The parameter k as a series in its half widths."""
        parameters = list(self._all.parameters)
        parameters[k] = arb_series([parameters[k], width], prec=2)
        return replace(self._all, parameters=parameters)

    @staticmethod
    def _model(equations: TrimEquations, dihedral: Any, series: Any, length: int) -> list[list[list[arb]]]:
        """Inputs, A and B; each a list of coefficients for every entry, column by column."""
        arguments = equations.arguments(dihedral, series, length)
        _, A, B = equations.jacobians(*arguments)
        return [[coefficients(entry, length) for entry in entries] for entries in (arguments[1], A, B)]


def _matrix(entries: list[list[arb]], order: int, rows: Sequence[int], columns: Sequence[int]) -> arb_mat:
    """One coefficient of a matrix that is stored column by column."""
    height = len(entries) if len(columns) == 1 else len(STATES)
    return arb_mat([[entries[height * j + i][order] for j in columns] for i in rows])


def _form(
    box: DihedralBox,
    thin: list[list[arb]],
    wide: list[list[arb]],
    rows: Sequence[int],
    columns: Sequence[int],
    errors: Sequence[arb_mat] = (),
) -> TaylorModel:
    """F(η_0 + s r) = F_0 + F_1 r s + F_2 r² s² + F_3(ξ) r³ s³, F_3 anywhere on the box (Lagrange)."""
    middle = [_matrix(thin, j, rows, columns) * box.radius**j for j in range(ORDER)]
    return TaylorModel(*middle, _matrix(wide, ORDER, rows, columns) * symmetric(box.radius**ORDER), *errors)
