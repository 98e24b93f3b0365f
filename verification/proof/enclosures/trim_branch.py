"""Boxes of a scheduling variable, such as the dihedral; the branch of trims over one and the linear
model, enclosed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from flint import arb, arb_mat, arb_series

from hfa_aircraft.model import Model
from hfa_support.errors import BadInputError
from hfa_support.linear_table import LinearTable
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point
from verification.proof.arithmetic.ball_function import Undecided
from verification.proof.arithmetic.balls import (
    TaylorModel,
    as_read,
    doubles,
    exact,
    inside,
    interval,
    matrix,
    symmetric,
)
from verification.proof.arithmetic.steady_flight import SteadyFlight, steady_flight

Proved = TypeVar("Proved")
#: Limits farther away than this are none.
_FAR = 1e300
#: Coefficients of the polynomial: 1, τ, τ². The remainder is of third order.
_ORDER = 3
#: Attempts to widen a box of unknowns until Krawczyk's operator maps it into itself.
_ATTEMPTS = 6
#: Least half width of a box of unknowns: what is known exactly still needs an interior.
_TINY = 1e-30
#: Widest box with errors of the parameters, whose derivatives are enclosed to first order, in steps
#: of the family.
_WIDEST_WITH_ERRORS = 0.25
#: Half width, relative, of the first box of unknowns for all parameters.
_FIRST = 1e-4
Series = Sequence[Sequence[arb]]


@dataclass(frozen=True)
class PlaceBox:
    """The places η from `low` to `high`, both included; low < high, exact doubles. Of an angle they
    are degrees.

    s = (η - middle) / radius is the place of a Taylor model on the box.
    """

    low: float
    high: float

    @cached_property
    def middle(self) -> arb:
        """(low + high) / 2, exact."""
        return (exact(self.low) + exact(self.high)) / 2

    @cached_property
    def radius(self) -> arb:
        """(high - low) / 2, exact."""
        return (exact(self.high) - exact(self.low)) / 2

    @cached_property
    def places(self) -> arb:
        """The ball of all places of the box."""
        return interval(self.low, self.high)


def bisected(
    boxes: list[PlaceBox],
    prove: Callable[[PlaceBox], Proved | None],
    narrowest: float,
    start: float = -math.inf,
) -> Iterator[tuple[PlaceBox, Proved | None]]:
    """Each box with what `prove` returns, or its halves where that is None or it is `Undecided`.

    A box no wider than `narrowest` is not halved but comes with None. Boxes up to `start` are
    passed over, and bisected as if none of them had been proved as a whole: a continued proof has
    the same boxes there."""
    waiting = boxes[::-1]
    while waiting:
        box = waiting.pop()
        if box.high <= start:
            continue
        wide, proved = box.high - box.low > narrowest, None
        if not (wide and box.low < start):
            with suppress(Undecided):
                proved = prove(box)
        if proved is None and wide:
            cut = float(box.middle)
            waiting += [PlaceBox(cut, box.high), PlaceBox(box.low, cut)]
        else:
            yield box, proved


@dataclass(frozen=True)
class Family:
    """Steady flights of a model that differ in its scheduling variable alone, whose values are
    places: of an angle in degrees, else in the model's unit.

    aircraft: the model; parameters are its doubles. flights: what is imposed and left free, the
    model's own unless given. spread: parameter -> half width within which it may lie. decimals:
    every parameter and setting is a ball that also holds the decimal it was read from; else it is
    the double exactly."""

    aircraft: Model
    flights: TrimCondition | None = None
    spread: Mapping[str, float] = field(default_factory=dict)
    decimals: bool = True

    @cached_property
    def model(self) -> Model:
        """Whose equations and names these are."""
        return self.aircraft

    @property
    def over(self) -> str:
        """The scheduling variable."""
        return self.model.schedule

    @property
    def unit(self) -> str:
        """Of the places, as people write them."""
        return self.model.schedule_unit

    @property
    def step(self) -> float:
        """A power of two of the places that is to them what 1 deg is to an angle, of the nominal
        value 1/57."""
        nominal = self.model.signals[self.over].nominal
        return 1.0 if self.unit == "deg" else float(2.0 ** round(math.log2(math.radians(nominal))))

    def value(self, place: Any) -> Any:
        """The scheduling variable at a place, a double or a ball, in the model's unit; π is
        enclosed."""
        if self.unit != "deg":
            return place
        return place * arb.pi() / 180 if isinstance(place, arb) else math.radians(place)

    def condition(self, place: float | None = None) -> TrimCondition:
        """The trim at a place; at the model's own unless given."""
        flights = usual_condition(self.model) if self.flights is None else self.flights
        return flights.at(
            None if place is None or self.over in self.model.parameters else self.value(place)
        )

    def point(self, place: float) -> OperatingPoint:
        """The trim at a place, in doubles. Raises TrimError."""
        model, condition = self.model, self.condition(place)
        if self.over in model.parameters:
            model = model.with_parameters(**{self.over: self.value(place)})
        return find_operating_point(model, condition)

    def imposed(self) -> dict[str, float]:
        """What every trim of the family imposes."""
        return {
            name: value for name, value in self.condition().imposed.items() if name != self.over
        }

    def limits(self) -> dict[str, tuple[float, float]]:
        """Limits of the states, inputs and outputs that a trim does not impose."""
        condition, model = self.condition(), self.model
        names = dict.fromkeys((*model.states, *model.inputs, *model.variables, *model.outputs))
        ends = {
            name: condition.limits_of(name)
            for name in names
            if name not in {*condition.imposed, self.over}
        }
        return {
            name: (max(low, -_FAR), min(high, _FAR))
            for name, (low, high) in ends.items()
            if np.isfinite((low, high)).any()
        }

    def check(self, low: float, high: float) -> None:
        """BadInputError unless the trims of the interval are of the kind that is proved."""
        model = self.model
        if not self.over:
            raise BadInputError(
                f"{model.name} declares no schedule; name the variable that a proof runs over"
            )
        if self.flights is not None:
            for name in (
                each
                for each, value in self.flights.imposed.items()
                if isinstance(value, LinearTable)
            ):
                raise BadInputError(
                    f"{name} changes with the {self.over} in this condition; --hold it at one value"
                )
        first, _ = (self.condition(end) for end in (low, high))
        still = first.rates == dict.fromkeys(model.steady, 0.0)
        branch = TrimBranch(self)
        if not (still and self.over not in first.free and len(first.free) == len(branch.rows)):
            raise BadInputError(
                f"a proof takes trims at a given {self.over}, all rates 0, with {len(branch.rows)} unknowns; "
                f"here free are {', '.join(first.free)}: change --hold and --free"
            )


@dataclass(frozen=True, eq=False)
class TrimEquations:
    """F(w, η) = 0; w: the free variables, of which a series has a list of coefficients for each.

    known: name of an imposed variable or a parameter -> ball, one of which may be a series.
    """

    family: Family
    flight: SteadyFlight
    known: dict[str, Any]

    def values(self, place: Any, series: Series, length: int) -> dict[str, Any]:
        """Of variables and parameters at a place, or a series of it, in the model's unit."""
        unknown = (arb_series(list(own[:length]), prec=length) for own in series)
        return (
            self.known
            | {self.family.over: place}
            | dict(zip(self.flight.free, unknown, strict=True))
        )

    def along(self, places: arb, length: int) -> arb_series:
        """The scheduling variable at places + τ as a series of `length` coefficients."""
        return arb_series([self.family.value(places), self.family.value(exact(1.0))], prec=length)

    def residual(self, place: Any, series: Series, length: int) -> list[list[arb]]:
        """Coefficients of F, a list for each equation that the unknowns move."""
        found = [
            _coefficients(each, length)
            for each in self.flight.left(self.values(place, series, length))
        ]
        for i, name in enumerate((*self.family.model.steady, *self.flight.outputs)):
            if i not in self.flight.rows and any(each != 0 for each in found[i]):
                raise BadInputError(
                    f"the rate of {name} is not 0 whatever is free; change --hold and --free"
                )
        return [found[i] for i in self.flight.rows]

    def model_of(self, place: Any, series: Series, length: int) -> dict[str, list[arb_mat]]:
        """The coefficients of the values that have limits, of A and B, and of the unknowns."""
        values, _, A, B = self.flight.linear(self.values(place, series, length))
        parts = {"unknowns": [[arb_series(list(own[:length]), prec=length)] for own in series]}
        parts |= {"values": values, "A": A, "B": B}
        flat = {
            name: [[_coefficients(one, length) for one in row] for row in rows]
            for name, rows in parts.items()
        }
        return {
            name: [arb_mat([[one[j] for one in row] for row in rows]) for j in range(length)]
            for name, rows in flat.items()
        }

    def derivative(self, places: arb, values: list[arb]) -> arb_mat:
        """F_w at constant arguments."""
        slopes = self.flight.linear(
            self.values(self.family.value(places), [[value] for value in values], 1)
        )[1]
        return arb_mat([[_coefficients(one, 1)[0] for one in slopes[i]] for i in self.flight.rows])

    def inverse(self, places: arb, values: list[arb]) -> arb_mat:
        """A matrix of balls that holds the inverse of F_w."""
        derivative = self.derivative(places, values)
        try:
            rough = matrix(np.linalg.inv(doubles(derivative)))
            return (rough * derivative).inv() * rough
        except (ZeroDivisionError, np.linalg.LinAlgError) as error:
            raise Undecided(
                "the derivative of the trim equations may be singular on this box"
            ) from error

    def newton(self, places: arb, values: list[arb]) -> tuple[list[arb], arb_mat]:
        """C F(w, η) and C, the inverse of F_w rounded to doubles."""
        inverse = matrix(np.linalg.inv(doubles(self.derivative(places.mid(), values))))
        residual = self.residual(self.family.value(places), [[value] for value in values], 1)
        return (inverse * arb_mat(residual)).entries(), inverse

    def contracted(self, places: arb, middle: list[arb], widths: list[arb]) -> list[arb]:
        """Balls about `middle` that Krawczyk's operator maps into their interior, as it leaves
        them."""
        step, inverse = self.newton(places, middle)
        identity = matrix(np.eye(len(middle)))
        for _ in range(_ATTEMPTS):
            offsets = [symmetric(1.2 * width) for width in widths]
            candidate = [value + offset for value, offset in zip(middle, offsets, strict=True)]
            jacobian = self.derivative(places, candidate)
            image = (identity - inverse * jacobian) * arb_mat([[offset] for offset in offsets])
            mapped = [row - change for change, row in zip(step, image.entries(), strict=True)]
            if inside(mapped, offsets):
                return [value + offset for value, offset in zip(middle, mapped, strict=True)]
            widths = [
                abs(before.union(after)).upper()
                for before, after in zip(offsets, mapped, strict=True)
            ]
        raise Undecided("Krawczyk's operator does not map a box of unknowns into itself")

    def around(self, places: arb, start: list[arb], widths: list[arb]) -> list[arb]:
        """Such balls, which hold the known part too."""
        found = self.contracted(places, [value.mid() for value in start], widths)
        if not all(ball.contains(value) for ball, value in zip(found, start, strict=True)):
            raise Undecided("the trim at the middle of the box is not the one found around it")
        return found

    def branch(self, places: arb, start: list[arb], length: int) -> list[list[arb]]:
        """Taylor coefficients w_0 .. in the place of the branch through `start`; a list an
        unknown."""
        series, solved = [[value] for value in start], self.inverse(places, start)
        for j in range(1, length):
            residual = self.residual(self.along(places, j + 1), series, j + 1)
            change = solved * arb_mat([[each[j]] for each in residual])
            for own, value in zip(series, change.entries(), strict=True):
                own.append(-value)
        return series


def _coefficients(value: Any, length: int) -> list[arb]:
    """Of a series or a ball, `length` of them."""
    return (
        [value] + [arb(0)] * (length - 1)
        if isinstance(value, arb)
        else [value[index] for index in range(length)]
    )


@dataclass(frozen=True, eq=False)
class ModelForms:
    """A(η), (n, n), and B(η), (n, m), of the linear model over a box.

    trim: free variable -> c_0, c_1, c_2 of its polynomial, how far Newton's step goes from there,
    and what each error does to it, in doubles. The parameters with a half width are the errors."""

    box: PlaceBox
    trim: dict[str, list[float]]
    A: TaylorModel
    B: TaylorModel


class TrimBranch:
    """Encloses trims and linear models of a family of flights.

    On a box, Krawczyk's operator K(W) = ŵ - C F(ŵ, η) + (I - C F_w(W, η)) (W - ŵ) maps W into its
    own interior: for every η of the box there is one and only one w(η) in W (Krawczyk 1969; Moore
    1977), and it is smooth. Its Taylor coefficients follow one after the other from F_w w_j =
    -[F(Σ_{i<j} w_i τ^i, η + τ)]_j."""

    def __init__(self, family: Family) -> None:
        self.family, model, imposed = family, family.model, family.imposed()
        flight, ball = steady_flight(model, imposed), as_read if family.decimals else exact
        self.free, self.rows, self._names = flight.free, flight.rows, flight.names
        values = {name: signal.start for name, signal in model.parameters.items()} | imposed
        known = {name: ball(value) for name, value in values.items()}
        self._widths = {name: exact(width) for name, width in family.spread.items() if width > 0.0}
        widened = {name: known[name] + symmetric(width) for name, width in self._widths.items()}
        self._known = TrimEquations(family, flight, known)
        self._all = TrimEquations(family, flight, known | widened)

    def forms(self, box: PlaceBox) -> ModelForms:
        """The model over a box. Undecided when the box is too wide or a trim may lie beyond its
        limits, TrimError when its middle has no trim."""
        if self._widths and box.radius > _WIDEST_WITH_ERRORS * self.family.step / 2:
            raise Undecided("the errors of the parameters are enclosed on narrower boxes only")
        known, at_middle = (
            self._known,
            self._known.branch(box.middle, self.trim_at(float(box.middle)), _ORDER),
        )
        # A ball for each unknown that holds the branch on the whole box: w(η) = w(η_0) + w'(ξ) (η -
        # η_0).
        start = [series[0] for series in at_middle]
        widths = [
            series[0].rad() + abs(series[1]).upper() * box.radius + exact(_TINY)
            for series in at_middle
        ]
        slopes = known.branch(box.places, known.around(box.places, start, widths), 2)
        everywhere = [
            value + symmetric(box.radius) * series[1]
            for value, series in zip(start, slopes, strict=True)
        ]
        thin = known.model_of(known.along(box.middle, _ORDER), at_middle, _ORDER)
        far = known.branch(box.places, everywhere, _ORDER + 1)
        wide = known.model_of(known.along(box.places, _ORDER + 1), far, _ORDER + 1)
        errors = list(self._errors(box, everywhere)) if self._widths else []
        # F(η_0 + s r) = F_0 + F_1 r s + F_2 r² s² + F_3(ξ) r³ s³, F_3 anywhere on the box
        # (Lagrange).
        powers, last = [box.radius**j for j in range(_ORDER)], symmetric(box.radius**_ORDER)
        forms = {
            name: TaylorModel(
                *(part * power for part, power in zip(thin[name], powers, strict=True)),
                wide[name][_ORDER] * last,
                *(each[name] for each in errors),
            )
            for name in thin
        }
        ranges = dict(zip(self.free, forms["unknowns"].range().entries(), strict=True))
        ranges |= zip(self._names, forms["values"].range().entries(), strict=True)
        for name, (low, high) in self.family.limits().items():
            if not exact(low) <= ranges[name] <= exact(high):
                raise Undecided(f"{name} may lie beyond its limits")
        c0, c1, c2, _, *z = (
            [float(entry.mid()) for entry in part.entries()] for part in forms["unknowns"].parts
        )
        polynomials = list(zip(c0, c1, c2, *z, strict=True))
        steps = self._steps(box, polynomials, everywhere)
        trim = {
            name: [*row[:3], step, *row[3:]]
            for name, row, step in zip(self.free, polynomials, steps, strict=True)
        }
        return ModelForms(box, trim, forms["A"], forms["B"])

    def _steps(
        self, box: PlaceBox, polynomials: list[tuple[float, ...]], everywhere: list[arb]
    ) -> list[float]:
        """Bounds of C F along polynomials of the unknowns, C about the inverse of F_w, in the
        checker's arithmetic."""
        none, values = arb(0), dict[str, Any]()
        for name, ball in self._known.known.items():
            errors = [width * (name == other) for other, width in self._widths.items()]
            values[name] = TaylorModel(ball, none, none, none, *errors)
        values[self.family.over] = TaylorModel(*map(self.family.value, (box.middle, box.radius)))
        for name, (c0, c1, c2, *slopes) in zip(self.free, polynomials, strict=True):
            values[name] = TaylorModel(*map(arb, (c0, c1, c2)), none, *map(arb, slopes))
        found = self._known.flight.left(values)
        left = arb_mat([[TaylorModel.of(found[i]).range()] for i in self.rows])
        C = matrix(np.linalg.inv(doubles(self._known.derivative(box.places, everywhere))))
        return [float(abs(entry).upper()) for entry in (C * left).entries()]

    def model_at(self, place: float) -> tuple[arb_mat, arb_mat]:
        """A (n, n) and B (n, m) at one place, in balls."""
        point = [[value] for value in self.trim_at(place)]
        found = self._known.model_of(self.family.value(exact(place)), point, 1)
        return found["A"][0], found["B"][0]

    def trim_at(self, place: float) -> list[arb]:
        """The unknowns at one place, in balls: Newton's method on midpoints, then Krawczyk."""
        at, values = exact(place), self.family.point(place).values
        middle = [exact(values[name]) for name in self.free]
        for _ in range(2):
            step, _ = self._known.newton(at, middle)
            middle = [(value - change).mid() for value, change in zip(middle, step, strict=True)]
        step, _ = self._known.newton(at, middle)
        return self._known.contracted(
            at, middle, [abs(change).upper() + exact(_TINY) for change in step]
        )

    def _errors(self, box: PlaceBox, known: list[arb]) -> Iterator[dict[str, arb_mat]]:
        """What each parameter does; `known`: the unknowns on the box without errors.

        w(η, p) = w(η, p_0) + Σ_k ∂w/∂p_k (p_k - p_0k), with the derivatives -F_w⁻¹ F_p anywhere
        between."""
        widths = [value.rad() * 2 + abs(value).upper() * _FIRST for value in known]
        found, place = self._all.around(box.places, known, widths), self.family.value(box.places)
        moved = [
            replace(
                self._all,
                known=self._all.known | {name: arb_series([self._all.known[name], width], prec=2)},
            )
            for name, width in self._widths.items()
        ]
        slopes: list[arb_mat] = []
        for _ in range(2):  # the second time with the narrower unknowns that the first time gives
            inverse, constant = self._all.inverse(box.places, found), [[value] for value in found]
            residuals = [each.residual(place, constant, 2) for each in moved]
            slopes = [
                -inverse * arb_mat([[each[1]] for each in residual]) for residual in residuals
            ]
            moves = [
                sum((symmetric(each[i, 0]) for each in slopes), exact(0.0))
                for i in range(len(found))
            ]
            found = [value + move for value, move in zip(known, moves, strict=True)]
        for equations, slope in zip(moved, slopes, strict=True):
            series = [[value, rise] for value, rise in zip(found, slope.entries(), strict=True)]
            yield {name: parts[1] for name, parts in equations.model_of(place, series, 2).items()}
