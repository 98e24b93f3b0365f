"""Trims and linear models on a box of scheduling values, with a proof that the trims exist.

The trims solve F(w, η) = 0. Let ŵ(s) be the stated polynomial, C ≈ F_w⁻¹ and e = w - ŵ. If
|C F(ŵ)| + |I - C F_w| < 1 in units of the radii r, there is exactly one root with |e_i| <= r_i at
every s, and the root is a smooth function of s (Krawczyk's test).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import zip_longest
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from flint import arb, arb_mat

from hfa_aircraft.model import Model
from hfa_prove.check.cover import check_covered
from hfa_prove.check.equilibrium import root_offsets
from hfa_prove.enclosure.ball_function import BallFunction
from hfa_prove.enclosure.balls import READING, symmetric
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Rejected
from hfa_prove.statements.flight import Flight, StatedTrim, TrimBox
from hfa_prove.statements.plant import SAME_TRIM

Rows = list[list[Any]]


class LinearParts(NamedTuple):
    """Trim values, Jacobian of the trim equations and linear model, each as a list of rows.

    The linear model is x' = A x + B u, y = C x + D u.

    values: (names, 1), values of the signals `SteadyFlight.names`
    slopes: (equations, unknowns), Jacobian F_w
    A: (n, n)
    B: (n, m)
    C: (k, n), rows of the measured outputs
    D: (k, m)
    """

    values: Rows
    slopes: Rows
    A: Rows
    B: Rows
    C: Rows
    D: Rows


@dataclass(frozen=True, eq=False)
class SteadyFlight:
    """Trim equations F(w; imposed, parameters) = 0 with unknowns w, and the linear model at a trim.

    balanced: BallFunction (v, p) -> the rates that must be 0, then the imposed outputs
    linear_parts: BallFunction (v, p) -> the parts of `LinearParts`
    variables: names of v, the variables of the trim: imposed, scheduling and unknown
    parameters: names of p
    imposed_outputs: names of the outputs that the trim imposes
    names: states, inputs and outputs with values in `LinearParts.values`
    unknowns: names of w
    moving_rows: indices of the equations that depend on an unknown
    heights: number of rows of each part of `LinearParts`
    """

    balanced: BallFunction
    linear_parts: BallFunction
    variables: tuple[str, ...]
    parameters: tuple[str, ...]
    imposed_outputs: tuple[str, ...]
    names: tuple[str, ...]
    unknowns: tuple[str, ...]
    moving_rows: tuple[int, ...]
    heights: tuple[int, ...]

    def residual(self, values: Mapping[str, Any]) -> list[Any]:
        """Return the residuals of the trim equations F.

        values: name -> ball, series or Taylor model, for every variable, parameter and imposed
            output
        """
        results = self.balanced(*self._arguments(values))[0]
        rates = len(results) - len(self.imposed_outputs)
        outputs = zip(results[rates:], self.imposed_outputs, strict=True)
        return results[:rates] + [output - values[name] for output, name in outputs]

    def linear(self, values: Mapping[str, Any]) -> LinearParts:
        """Return the trim values, the Jacobian of the trim equations and the linear model.

        values: name -> ball, series or Taylor model, for every variable and parameter
        """
        columns = self.linear_parts(*self._arguments(values))
        parts = []
        for entries, height in zip(columns, self.heights, strict=True):
            parts.append([entries[row::height] for row in range(height)])
        return LinearParts(*parts)

    def _arguments(self, values: Mapping[str, Any]) -> list[list[Any]]:
        """Return two lists: the values of the variables and the values of the parameters.

        values: name -> ball, series or Taylor model
        """
        return [[values[name] for name in names] for names in (self.variables, self.parameters)]


def steady_flight(
    model: Model,
    imposed: Mapping[str, float],
    limited: Sequence[str] = (),
    measured: Sequence[str] = (),
) -> SteadyFlight:
    """Return the trim equations and the linear model of an aircraft.

    imposed: variables and outputs that the trim imposes, besides the scheduling variable
    limited: names of signals with limits
    measured: names of the outputs of the linear model

    Raises BadInputError with the name of the operation if the equations contain an unsupported
    operation.
    """
    imposed_outputs = tuple(name for name in imposed if name not in model.variables)
    limited_outputs = [name for name in limited if name in model.outputs]
    unknowns = tuple(
        name for name in model.variables if name not in imposed and name != model.schedule
    )
    outputs = tuple(dict.fromkeys((*imposed_outputs, *limited_outputs)))
    return _steady_flight(model, unknowns, imposed_outputs, outputs, tuple(measured))


@lru_cache(maxsize=16)
def _steady_flight(
    model: Model,
    unknowns: tuple[str, ...],
    imposed_outputs: tuple[str, ...],
    outputs: tuple[str, ...],
    measured: tuple[str, ...],
) -> SteadyFlight:
    """Return the trim equations and the linear model of an aircraft, from hashable arguments.

    unknowns: names of the unknowns of the trim
    imposed_outputs: names of the outputs that the trim imposes
    outputs: names of the imposed outputs, then of other outputs with required values
    measured: names of the outputs of the linear model
    """
    states = list(model.states)
    variables = model.variables
    v = ca.SX.sym("v", len(variables))
    (p,) = model.layout.symbols("p")
    values = dict(zip(variables, ca.vertsplit(v), strict=True))
    x, u, f, y = model.layout.in_variables(values, p, outputs)
    y = ca.vec(y)
    _, _, A, B, C, D, *_ = model.functions(measured)(x, u, p)
    balanced = [states.index(name) for name in model.steady]
    linear = [states.index(name) for name in model.linear]

    F = ca.densify(ca.vertcat(f[balanced], y[: len(imposed_outputs), :]))
    w = ca.vertcat(*(values[name] for name in unknowns))
    rate_slopes = ca.mtimes(A[balanced, :], ca.jacobian(x, w))
    rate_slopes += ca.mtimes(B[balanced, :], ca.jacobian(u, w))
    output_slopes = ca.jacobian(y[: len(imposed_outputs), :], w)
    parts = [
        ca.vertcat(x, u, y),
        ca.vertcat(rate_slopes, output_slopes),
        A[linear, linear],
        B[linear, :],
        C[:, linear],
        D,
    ]
    moves = np.array(ca.DM(ca.jacobian_sparsity(F, w), 1)).any(axis=1)
    linear_parts = ca.Function("linear", [v, p], [ca.densify(part) for part in parts])
    return SteadyFlight(
        balanced=BallFunction(ca.Function("balanced", [v, p], [F]), model.name),
        linear_parts=BallFunction(linear_parts, model.name),
        variables=tuple(variables),
        parameters=tuple(model.parameters),
        imposed_outputs=imposed_outputs,
        names=(*states, *model.inputs, *outputs),
        unknowns=unknowns,
        moving_rows=tuple(np.flatnonzero(moves).tolist()),
        heights=tuple(part.shape[0] for part in parts),
    )


@dataclass(frozen=True, eq=False)
class LinearModelBox:
    """Linear model x' = A x + B u, y = C x + D u on a box of scheduling values.

    The matrices are Taylor models.

    trim: enclosure of the trims on the box
    A: (n, n)
    B: (n, m)
    C: (k, n), rows of the measured outputs
    D: (k, m)
    offsets: unknown -> enclosure of the trim minus its polynomial
    """

    trim: TrimBox
    A: TaylorModel
    B: TaylorModel
    C: TaylorModel
    D: TaylorModel
    offsets: Mapping[str, arb]


def linear_model_on(
    flight: Flight, trim: TrimBox, measured: Sequence[str] = (), *, decimals: bool = True
) -> LinearModelBox:
    """Return the linear model on a box of scheduling values.

    trim: stated enclosure of the trims on the box
    measured: names of the outputs of the linear model
    decimals: whether the model covers all decimal numbers that round to the stored parameters and
        imposed values, instead of the doubles alone

    Raises Rejected unless the box is proved to contain a trim within all limits.
    """
    model = flight.model
    equations = equations_of(flight, measured)
    imposed = known_values(flight, trim, decimals=decimals)
    along = dict(imposed)
    around = dict(imposed)
    for name, polynomial in trim.polynomials.items():
        along[name] = polynomial
        around[name] = polynomial + TaylorModel(0, 0, 0, symmetric(trim.radii[name]))
    linear = equations.linear(around)
    offsets = _root_offsets(equations.residual(along), linear, [*trim.radii.values()])
    values = dict(zip(equations.names, (value for (value,) in linear.values), strict=True)) | around
    _check_limits(flight, values)
    return LinearModelBox(
        trim,
        stacked(linear.A),
        stacked(linear.B),
        stacked(linear.C, columns=len(model.linear)),
        stacked(linear.D, columns=len(model.inputs)),
        dict(zip(trim.radii, offsets, strict=True)),
    )


def known_values(flight: Flight, trim: TrimBox, *, decimals: bool = True) -> dict[str, Any]:
    """Return name -> Taylor model of the known values of the trims on a box.

    The known values are the parameters, the imposed values and the scheduling variable.

    decimals: whether to cover all decimal numbers that round to the stored doubles
    """
    reading = READING if decimals else 0.0
    values: dict[str, Any] = {}
    for name, number in (dict(flight.imposed) | dict(flight.parameters)).items():
        ball = arb(number, abs(number) * reading)
        errors = [arb(width if name == owner else 0.0) for owner, width in flight.spread.items()]
        values[name] = TaylorModel(ball, arb(0), arb(0), arb(0), *errors)
    low = arb(trim.low)
    high = arb(trim.high)
    middle = flight.value((low + high) / 2)
    radius = flight.value((high - low) / 2)
    values[flight.model.schedule] = TaylorModel(middle, radius)
    return values


def _root_offsets(residual: Sequence[Any], linear: LinearParts, radii: list[arb]) -> list[arb]:
    """Return the trim minus the polynomials of a box, one ball for each unknown.

    residual: residual of the trim equations at the polynomials
    linear: Jacobian of the equations on the box
    radii: radii of the unknowns about the polynomials

    Raises Rejected unless exactly one trim within the radii is proved. An equation that depends on
    no unknown must be satisfied exactly.
    """
    moved = []
    for row, slopes in enumerate(linear.slopes):
        if not _is_zero([*slopes, residual[row]]):
            moved.append(row)
    if len(moved) != len(radii):
        raise Rejected(
            f"the numbers of trim equations ({len(moved)}) and of unknowns ({len(radii)}) differ"
        )
    column = stacked([[residual[row]] for row in moved])
    derivative = stacked([linear.slopes[row] for row in moved])
    offsets: list[arb] = root_offsets(column.range(), derivative.range(), radii).entries()
    return offsets


def _check_limits(flight: Flight, values: Mapping[str, Any]) -> None:
    """Raise Rejected unless every value of the trim on a box is proved to be within its limits.

    Imposed values and the scheduling variable are not compared here.

    values: name -> value on the box
    """
    for name, (least, most) in flight.limits.items():
        if name == flight.model.schedule or name in flight.imposed:
            continue
        value = TaylorModel.of(values[name]).range()
        if not (arb(least) <= value and value <= arb(most)):
            raise Rejected(f"{name} is not proved to be within its limits")


def _is_zero(values: Iterable[Any]) -> bool:
    """Return whether all parts of all given Taylor models, balls and numbers are exactly 0."""
    return all(part == 0 for value in values for part in TaylorModel.of(value).parts)


def stacked(rows: list[list[Any]], columns: int = 1) -> TaylorModel:
    """Return the Taylor model of a matrix whose entries are Taylor models of scalars.

    rows: entries of the matrix
    columns: number of columns if there are no rows
    """
    if not rows:
        return TaylorModel(arb_mat(0, columns))
    parts = [TaylorModel.of(entry).parts for row in rows for entry in row]
    together = zip_longest(*parts, fillvalue=arb(0))
    return TaylorModel(*(arb_mat(len(rows), len(rows[0]), list(part)) for part in together))


def check_branches(flight: Flight, boxes: Sequence[LinearModelBox]) -> None:
    """Raise Rejected unless the trims of all boxes are proved to be on the stated branches.

    A branch extends from its stated trim to the next stated trim. Two boxes are on one branch if,
    at a common scheduling value, the trim of one box is in the enclosure of the other box, which
    contains only one trim.
    """
    starts = [trim.breakpoint for trim in flight.trims]
    ascending = sorted(boxes, key=lambda box: (box.trim.low, box.trim.high))
    if ascending and not (starts and starts[0] <= ascending[0].trim.low):
        raise Rejected(
            "a box begins below the first trim in the certificate, so the branch of this box is "
            "unknown"
        )
    for stated, following in zip(flight.trims, [*starts[1:], math.inf], strict=True):
        own = [box for box in ascending if stated.breakpoint <= box.trim.low < following]
        _check_branch(_stated_trim(flight, stated), own, following)


def _check_branch(
    stated: LinearModelBox, boxes: Sequence[LinearModelBox], following: float
) -> None:
    """Raise Rejected unless a branch of trims is proved to begin at a stated trim.

    The boxes must contain the stated trim, be connected, and end below the next stated trim.

    stated: linear model at the stated trim
    boxes: linear models on the boxes of the branch, in ascending order
    following: scheduling value of the next stated trim, or inf
    """
    start = stated.trim.low
    ends = [[(box.trim.low, box.trim.high)] for box in boxes]
    check_covered("the trims of the boxes", [(start, start)], ends)
    connected = [stated]
    for box in boxes:
        connected = [before for before in connected if before.trim.high >= box.trim.low]
        if not any(_is_same(box, before) for before in connected):
            raise Rejected(
                f"the trims from {box.trim.low} to {box.trim.high} are not proved to be on the "
                f"branch of the trim stated at {start}"
            )
        if box.trim.high >= following:
            raise Rejected(
                f"a box of this branch contains {following}, where another branch is stated"
            )
        connected.append(box)


def _stated_trim(flight: Flight, trim: StatedTrim) -> LinearModelBox:
    """Return the linear model at the only trim within `SAME_TRIM` nominal values of a stated trim.

    The errors of the parameters (`spread`) are not included.
    """
    polynomials = {name: TaylorModel(arb(x)) for name, x in trim.unknowns.items()}
    radii = {name: arb(SAME_TRIM * flight.model.signals[name].nominal) for name in trim.unknowns}
    box = TrimBox(trim.breakpoint, trim.breakpoint, polynomials, radii)
    return linear_model_on(replace(flight, spread={}), box)


def _is_same(box: LinearModelBox, other: LinearModelBox) -> bool:
    """Return whether two boxes are proved to have one trim at a common scheduling value.

    The scheduling value is the lowest common one.
    """
    at = max(box.trim.low, other.trim.low)
    if at > min(box.trim.high, other.trim.high):
        return False
    return _holds_root(other, box, at) or _holds_root(box, other, at)


def _holds_root(box: LinearModelBox, other: LinearModelBox, scheduling_value: float) -> bool:
    """Return whether the trim of `other` is in the enclosure of `box`, which contains one trim.

    If both boxes include errors of the parameters, the condition must hold for all errors.
    Otherwise the errors are omitted.

    scheduling_value: a scheduling value in both boxes
    """
    for name, offset in other.offsets.items():
        here = _polynomial_at(box.trim, name, scheduling_value)
        there = _polynomial_at(other.trim, name, scheduling_value)
        between = there.center - here.center
        if here.errors and there.errors:
            between = (there - here).range()
        if not symmetric(box.trim.radii[name]).contains_interior(offset + between):
            return False
    return True


def _polynomial_at(trim: TrimBox, name: str, scheduling_value: float) -> TaylorModel:
    """Return the polynomial of an unknown at a scheduling value, a model in the errors alone.

    name: name of the unknown
    """
    if trim.low == trim.high:
        return trim.polynomials[name]
    low = arb(trim.low)
    high = arb(trim.high)
    return trim.polynomials[name].at((2 * arb(scheduling_value) - low - high) / (high - low))


def equations_of(flight: Flight, measured: Sequence[str] = ()) -> SteadyFlight:
    """Return the trim equations and the linear model of an aircraft.

    measured: names of the outputs of the linear model
    """
    return steady_flight(flight.model, flight.imposed, tuple(flight.limits), measured)
