"""Trims of an aircraft over an interval of its scheduling variable, as polynomials on boxes.

The trims are computed in double precision. The checker's test then proves them on every box.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from flint import arb

from hfa_aircraft.model import Model
from hfa_prove.check.trims import (
    LinearModelBox,
    Rejected,
    equations_of,
    known_values,
    linear_model_on,
    stacked,
)
from hfa_prove.enclosure.ball_function import Undecided
from hfa_prove.enclosure.balls import doubles, matrix
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.statements.flight import Flight, StatedTrim, TrimBox, in_model_unit
from hfa_prove.statements.game import PointTrim
from hfa_support.arguments import checks_arguments
from hfa_support.errors import BadInputError
from hfa_support.linear_table import LinearTable
from trim.point.condition import TrimCondition, usual_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import trim

Proved = TypeVar("Proved")
#: Limits beyond this value are treated as infinite.
_FAR = 1e300
#: Radius of a trim, in Newton steps times the root of the number of unknowns, and its least value
#: in nominal values.
_ROOM = 1.5
_FINEST = 1e-46
#: Number of Newton steps from a trim in doubles to the precision of the balls.
_STEPS = 4


class Box(NamedTuple):
    """Box of scheduling values from `low` to `high`, as exact doubles in the user's unit."""

    low: float
    high: float

    @property
    def middle(self) -> float:
        """Center of the box, at which the box is divided."""
        return (self.low + self.high) / 2


def bisected(
    boxes: Sequence[Box],
    prove: Callable[[Box], Proved | None],
    narrowest: float,
    start: float = -math.inf,
) -> Iterator[tuple[Box, Proved | None]]:
    """Yield boxes, each with the result of `prove`.

    A box is halved if `prove` returns None, or raises Undecided or Rejected. A box that is no wider
    than `narrowest` is not halved. If such a box is not proved, it is yielded with None.

    boxes: boxes to prove, in ascending order
    prove: box -> result, or None
    narrowest: smallest width of a box that is halved
    start: end of the part that is already proved. Boxes below `start` are skipped, and boxes that
        contain `start` are halved without a trial. A resumed proof then has the same boxes as an
        uninterrupted one.
    """
    waiting = list(boxes)[::-1]
    while waiting:
        box = waiting.pop()
        if box.high <= start:
            continue
        is_wide = box.high - box.low > narrowest
        proved = None
        if not (is_wide and box.low < start):
            with suppress(Undecided, Rejected):
                proved = prove(box)
        if proved is None and is_wide:
            waiting += [Box(box.middle, box.high), Box(box.low, box.middle)]
        else:
            yield box, proved


@checks_arguments
@dataclass(frozen=True)
class Family:
    """Trims of an aircraft at any value of its scheduling variable.

    model: the aircraft with its declared parameter values
    flights: trim condition, or None for the condition of the model's trim
    spread: parameter -> half-width of the possible values
    """

    model: Model
    flights: TrimCondition | None = None
    spread: Mapping[str, float] = field(default_factory=dict)

    @property
    def step(self) -> float:
        """Unit of box widths, in the unit of the scheduling variable.

        The unit is 1 deg for an angle. For another variable, it is the power of two nearest to π /
        180 nominal values on a logarithmic scale.
        """
        if self.model.schedule_unit == "deg":
            return 1.0
        nominal = self.model.signals[self.model.schedule].nominal
        return float(2.0 ** round(math.log2(math.radians(nominal))))

    def condition(self, scheduling_value: float | None = None) -> TrimCondition:
        """Return the trim condition at a scheduling value, by default at the model's own value."""
        flights = usual_condition(self.model) if self.flights is None else self.flights
        if scheduling_value is None or self.model.schedule in self.model.parameters:
            return flights.at(None)
        return flights.at(in_model_unit(self.model, scheduling_value))

    def point(self, scheduling_value: float) -> OperatingPoint:
        """Return the trim at a scheduling value, in double precision.

        Raises TrimError if there is no trim.
        """
        model = self.model
        if model.schedule in model.parameters:
            value = in_model_unit(model, scheduling_value)
            model = model.with_parameters(**{model.schedule: value})
        return trim(model, self.condition(scheduling_value))

    def flight(self, low: float, high: float) -> Flight:
        """Return the trims from `low` to `high` in the form of a statement, without stated trims.

        Raises BadInputError if a limit is wider than the model's.
        """
        model = self.model
        condition = self.condition()
        imposed = dict(condition.imposed)
        imposed.pop(model.schedule, None)
        limits = {}
        for name, (least, most) in model.limits.items():
            lowest, highest = condition.limits_of(name)
            if lowest < least or highest > most:
                raise BadInputError(
                    f"the limits of {name} are wider than the model's, "
                    f"{model.describe(name, least)} to "
                    f"{model.describe(name, most)}; narrow these limits"
                )
            if np.isfinite((lowest, highest)).any() and name not in model.disturbances:
                limits[name] = (max(lowest, -_FAR), min(highest, _FAR))
        parameters = {name: signal.start for name, signal in model.parameters.items()}
        spread = {name: width for name, width in self.spread.items() if width > 0.0}
        return Flight(model, parameters, spread, imposed, limits, (low, high))

    def require_schedule(self) -> None:
        """Raise BadInputError if the model has no scheduling variable."""
        if not self.model.schedule:
            raise BadInputError(
                f"{self.model.title} has no scheduling variable, which a proof requires; set "
                "`schedule` in the model"
            )

    def check(self, low: float, high: float) -> None:
        """Raise BadInputError unless proofs support the trims from `low` to `high`.

        The conditions are:
        - The model has a scheduling variable.
        - No imposed value depends on the scheduling variable.
        - All rates of the trim are 0.
        - The scheduling variable is not free, and there are as many free variables as equations.
        """
        model = self.model
        self.require_schedule()
        if self.flights is not None:
            for name, value in self.flights.imposed.items():
                if isinstance(value, LinearTable):
                    raise BadInputError(
                        f"{name} depends on the {model.schedule} in this flight condition; give "
                        f"one value with --hold {name}=VALUE"
                    )
        first = self.condition(low)
        self.condition(high)
        flight = self.flight(low, high)
        equations = equations_of(flight)
        count = len(equations.moving_rows)
        steady = first.rates == dict.fromkeys(model.steady, 0.0)
        if not (steady and model.schedule not in first.free and len(first.free) == count):
            raise BadInputError(
                f"a proof requires trims at a given {model.schedule} with all rates 0 and {count} "
                f"free variables, but the free variables are {', '.join(first.free)}; change "
                "--hold and --free"
            )


class TrimSearch:
    """Trims of an aircraft on boxes of scheduling values, and the linear models proved there.

    family: aircraft and its trims
    low, high: ends of the interval
    measured: names of the outputs of the linear models

    Raises BadInputError if an equation that depends on no unknown is not satisfied. Raises
    TrimError if no trim exists at `low`.
    """

    def __init__(
        self, family: Family, low: float, high: float, measured: Sequence[str] = ()
    ) -> None:
        self.family = family
        self.flight = family.flight(low, high)
        self.measured = tuple(measured)
        self._equations = equations_of(self.flight, self.measured)
        self._rows = self._equations.moving_rows
        self._linear_models: dict[Box, LinearModelBox] = {}
        self._refuse_unbalanced(low)

    def linear_model(self, box: Box) -> LinearModelBox:
        """Return the linear model that the checker proves on a box.

        Raises Undecided or Rejected if the box is too wide or a trim may exceed its limits. Raises
        TrimError if no trim exists at the center.
        """
        if box not in self._linear_models:
            trim_of_box = self.trim_box(box)
            self._linear_models[box] = linear_model_on(self.flight, trim_of_box, self.measured)
        return self._linear_models[box]

    def _refuse_unbalanced(self, low: float) -> None:
        """Raise BadInputError if an equation that depends on no unknown is not satisfied at a trim.

        low: scheduling value of the trim
        """
        start = self.family.point(low).values
        trim_of_box = TrimBox(low, low, {}, {})
        values: dict[str, Any] = known_values(self.flight, trim_of_box, decimals=False)
        values |= {name: arb(float(start[name])) for name in self._equations.unknowns}
        residual = self._equations.residual(values)
        names = (*self.flight.model.steady, *self._equations.imposed_outputs)
        for row, name in enumerate(names):
            if row not in self._rows and not TaylorModel.of(residual[row]).range() == 0:
                raise BadInputError(
                    f"no values of the free variables satisfy the equation of {name}; change "
                    "--hold or --free"
                )

    def trim_box(self, box: Box) -> TrimBox:
        """Return polynomials of the trims on a box, with radii that the checker can prove."""
        unknowns = self._equations.unknowns
        middle = self._newton(box.middle)
        C = matrix(np.linalg.inv(doubles(self._slopes(box.middle, middle))))
        polynomials = {name: TaylorModel(c0) for name, c0 in zip(unknowns, middle, strict=True)}
        trim_of_box = TrimBox(box.low, box.high, polynomials, {})
        slopes = _steps(C, self._residual(trim_of_box).slope)
        for c0, c1, name in zip(middle, slopes, unknowns, strict=True):
            polynomials[name] = TaylorModel(c0, c1)
        by_error = [_steps(C, column) for column in self._residual(trim_of_box).errors]
        errors = list(zip(*by_error, strict=True)) or [()] * len(unknowns)
        for c0, c1, z, name in zip(middle, slopes, errors, unknowns, strict=True):
            polynomials[name] = TaylorModel(c0, c1, arb(0), arb(0), *z)
        bends = _steps(C, self._residual(trim_of_box).bend)
        for c2, name in zip(bends, unknowns, strict=True):
            polynomials[name] += TaylorModel(arb(0), arb(0), c2)
        trim_of_box.radii.update(self._radii(C, self._residual(trim_of_box), _ROOM))
        return trim_of_box

    def point_trim(self, scheduling_value: float) -> PointTrim:
        """Return the center and the radii of the trim at a scheduling value.

        The radii are those for the stored doubles, and those for all decimal numbers that round to
        them.
        """
        unknowns = self._equations.unknowns
        values = self._newton(scheduling_value, precise=True)
        C = matrix(np.linalg.inv(doubles(self._slopes(scheduling_value, values))))
        center = {name: TaylorModel(c0) for name, c0 in zip(unknowns, values, strict=True)}
        trim_of_box = TrimBox(scheduling_value, scheduling_value, center, {})
        of_doubles = self._radii(C, self._residual(trim_of_box, decimals=False), 2 * _ROOM)
        of_decimals = self._radii(C, self._residual(trim_of_box, decimals=True), 2 * _ROOM)
        return PointTrim(center, of_doubles, of_decimals)

    def _radii(self, C: Any, residual: TaylorModel, room: float) -> dict[str, arb]:
        """Return unknown -> radius within which the checker can prove the trim.

        The radius is √n times the size of the Newton step C F times `room`, plus a small multiple
        of the nominal value.

        C: approximate inverse of F_w
        residual: residual F of the trim equations
        """
        unknowns = self._equations.unknowns
        steps = (C * residual.range()).entries()
        factor = room * math.sqrt(len(unknowns))
        radii = {}
        for name, step in zip(unknowns, steps, strict=True):
            nominal = self.family.model.signals[name].nominal
            radii[name] = arb(factor * float(abs(step).upper()) + _FINEST * nominal)
        return radii

    def stated_trim(self, scheduling_value: float) -> StatedTrim:
        """Return the trim at a scheduling value as stated in a certificate, rounded to doubles."""
        values = map(float, self._newton(scheduling_value))
        return StatedTrim(
            scheduling_value, dict(zip(self._equations.unknowns, values, strict=True))
        )

    def _newton(self, scheduling_value: float, *, precise: bool = False) -> list[arb]:
        """Return the values of the unknowns at a scheduling value, by Newton's method.

        precise: whether to use more steps and to keep all digits instead of rounding to doubles
        """
        unknowns = self._equations.unknowns
        start = self.family.point(scheduling_value).values
        values = [arb(float(start[name])) for name in unknowns]
        C = matrix(np.linalg.inv(doubles(self._slopes(scheduling_value, values))))
        for _ in range(_STEPS if precise else 1):
            pairs = zip(unknowns, values, strict=True)
            center = {name: TaylorModel(c0) for name, c0 in pairs}
            trim_of_box = TrimBox(scheduling_value, scheduling_value, center, {})
            steps = (C * self._residual(trim_of_box, decimals=False).center).entries()
            values = [(value - step).mid() for value, step in zip(values, steps, strict=True)]
        return values if precise else [arb(float(value)) for value in values]

    def _residual(self, trim_of_box: TrimBox, *, decimals: bool = True) -> TaylorModel:
        """Return the residual F of the trim equations at the polynomials of a box, a column.

        decimals: whether to cover all decimal numbers that round to the stored doubles
        """
        values: dict[str, Any] = known_values(self.flight, trim_of_box, decimals=decimals)
        values |= trim_of_box.polynomials
        residual = self._equations.residual(values)
        return stacked([[residual[row]] for row in self._rows])

    def _slopes(self, scheduling_value: float, values: Sequence[arb]) -> Any:
        """Return the Jacobian F_w of the trim equations at a scheduling value.

        values: values of the unknowns
        """
        trim_of_box = TrimBox(scheduling_value, scheduling_value, {}, {})
        imposed = known_values(self.flight, trim_of_box, decimals=False)
        at: dict[str, Any] = {name: model.center for name, model in imposed.items()}
        at |= dict(zip(self._equations.unknowns, values, strict=True))
        slopes = self._equations.linear(at).slopes
        return stacked([slopes[row] for row in self._rows]).center


def _steps(C: Any, column: Any) -> list[arb]:
    """Return the midpoints of -C F for a column F of balls, rounded to doubles."""
    return [arb(float(-step.mid())) for step in (C * column).entries()]
