"""Smooth copies of functions with tables and switches, for an optimizer of two derivatives.

Near a nonsmooth point, the copy blends the two branches. Elsewhere the copy equals the function.
The width of the blend is proportional to the spread of its argument over given points. The copy is
therefore independent of units.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_flight.plan.problem import FlightProblem
from hfa_support.errors import BadInputError

_COMPARISONS = (ca.OP_LT, ca.OP_LE)
_NONSMOOTH = (ca.OP_FMIN, ca.OP_FMAX, ca.OP_FABS)
_LOGIC = (ca.OP_NOT, ca.OP_AND, ca.OP_OR, ca.OP_IF_ELSE_ZERO)
#: An argument is constant if its range is less than this fraction of its magnitude.
_LEAST_VARIATION = 1e-9
#: Half-width of a blend, in standard deviations of its argument. The points are within the
#: limits, and their states within _NEAR_TRIM nominal values of the trim.
_BLEND_WIDTH = 0.02
_NEAR_TRIM = 3.0
_BLEND_POINTS = 500


@lru_cache(maxsize=16)
def smooth_rates(problem: FlightProblem) -> ca.Function:
    """Return the rates of a problem with smoothed tables and switches, or the rates themselves."""
    of_states, of_inputs = problem.nominal
    pairs = zip(problem.state_limits, problem.input_limits, strict=True)
    below, above = (np.concatenate([z / of_states, v / of_inputs]) for z, v in pairs)
    # Random points are within the limits. Each state, whose limits may be wide, and each input
    # without limits is also within _NEAR_TRIM nominal values of the trim.
    range_of_inputs = (above - below)[len(of_states) :]
    reach_of_inputs = np.where(np.isfinite(range_of_inputs), np.inf, _NEAR_TRIM)
    reach = np.concatenate([np.full(len(of_states), _NEAR_TRIM), reach_of_inputs])
    rng = np.random.default_rng(0)
    shape = (_BLEND_POINTS, len(reach))
    near = rng.uniform(np.maximum(below, -reach), np.minimum(above, reach), shape)
    return smoothed(problem.rates, near, _BLEND_WIDTH)


def is_nonsmooth(problem: FlightProblem) -> bool:
    """Return whether the equations of a problem have nonsmooth points, as those of tables, that
    are smoothed for the optimizer.
    """
    # `smoothed` returns the function itself if there is nothing to smooth.
    return smooth_rates(problem) is not problem.rates


@lru_cache(maxsize=16)
def smooth_slopes(problem: FlightProblem) -> ca.Function:
    """Return the function (followed states, v) -> Jacobian of `smooth_rates`, in nominal values."""
    rates = smooth_rates(problem)
    at = ca.SX.sym("at", rates.numel_in(0))
    slopes = ca.densify(ca.jacobian(rates(at), at))
    return ca.Function("slopes", [at], [slopes], {"cse": True})


def smoothed(function: ca.Function, points: np.ndarray, part: float) -> ca.Function:
    """Return a copy of the function in which each nonsmooth point is smoothed.

    The function itself is returned if no operation has a continuous argument that comes near 0 at
    the points. Comparisons that select infinite values, comparisons for equality, and steps (floor,
    ceil) are not smoothed.

    function: CasADi SX function of a column (n,) with one result
    points: arguments for which the function is used, (N, n)
    part: half-width of a blend, in standard deviations of its argument over the points
    """
    symbol = ca.SX.sym("x", function.numel_in(0))
    # A first evaluation finds the nonsmooth points, a second one smooths them.
    sharp = _Replay(function, symbol)
    sharp.run()
    values = np.array(ca.Function("arguments", [symbol], [sharp.arguments_of_blends()])(points.T))
    blends = [_Blend.of(row, part) for row in values]
    if not any(blend.width for blend in blends):
        return function
    result = _Replay(function, symbol, blends).run()
    return ca.Function(function.name(), [symbol], [result], {"cse": True})


class _Value(NamedTuple):
    """Value of an instruction, and whether it is a smooth truth value between 0 and 1."""

    value: ca.SX
    is_soft: bool = False


@dataclass(frozen=True)
class _Blend:
    """Smoothing of one nonsmooth point, which is where the argument of an operation is 0.

    width: half-width of the blend in the argument, or 0 without a blend
    levels: the two values of an argument that takes only two values, or None
    """

    width: float
    levels: tuple[float, float] | None = None

    @staticmethod
    def of(values: np.ndarray, part: float) -> _Blend:
        """Return the smoothing of a nonsmooth point.

        values: its argument at the points
        part: as in `smoothed`
        """
        finite = values[np.isfinite(values)]
        size = np.abs(finite).max(initial=0.0)
        if len(finite) < len(values) or np.ptp(finite) <= _LEAST_VARIATION * size:
            return _Blend(0.0)  # infinite somewhere, or constant
        levels = np.unique(finite)
        if len(levels) == 2:  # such as a truth value
            low, high = levels.tolist()
            return _Blend(0.0, levels=(low, high))
        width = part * float(finite.std())
        comes_near_0 = finite.min() <= width and finite.max() >= -width
        if len(levels) < max(3, len(values) // 20) or not comes_near_0:
            return _Blend(0.0)  # few values, as of floor, or away from 0
        return _Blend(width)

    def step(self, argument: ca.SX, sharp: ca.SX) -> _Value:
        """Return the smoothed result of a comparison of an argument with 0.

        sharp: the result without a blend
        """
        # 1 above the width, 0 below -width, and smooth between; of two levels of opposite signs,
        # linear between the levels. The polynomial is the integral of 15/16 (1 - t²)² from -1.
        if self.levels is not None:
            low, high = self.levels
            if low < 0.0 < high:
                return _Value((argument - low) / (high - low), is_soft=True)
            return _Value(sharp)
        if self.width == 0.0:
            return _Value(sharp)
        t = ca.fmin(ca.fmax(argument / self.width, -1.0), 1.0)
        smooth = 0.5 + t * (15.0 - t**2 * (10.0 - 3.0 * t**2)) / 16.0
        return _Value(smooth, is_soft=True)

    def size(self, argument: ca.SX) -> ca.SX:
        """Return a copy of the absolute value with two continuous derivatives."""
        # The even polynomial equals |t| at ±1, with its first two derivatives.
        sharp = ca.fabs(argument)
        if self.width == 0.0:
            return sharp
        t = ca.fmin(ca.fmax(argument / self.width, -1.0), 1.0)
        square = t**2
        rounded = 0.375 + square * (0.75 - 0.125 * square)
        return sharp + self.width * (rounded - ca.fabs(t))


@dataclass
class _Replay:
    """Evaluation of a function's instructions on symbols, with smoothed nonsmooth points.

    function: CasADi SX function of a column (n,) with one result
    symbol: argument of the function, (n,)
    blends: smoothing of each nonsmooth point, in the order of the instructions; None smooths none
    arguments: arguments of the nonsmooth points found so far
    work: CasADi's work vector: place -> value of an instruction
    """

    function: ca.Function
    symbol: ca.SX
    blends: list[_Blend] | None = None
    arguments: list[ca.SX] = field(default_factory=list)
    work: dict[int, _Value] = field(default_factory=dict)

    def run(self) -> ca.SX:
        """Evaluate all instructions of the function and return its result as a dense expression."""
        function = self.function
        result = ca.SX.zeros(function.size_out(0))
        for number in range(function.n_instructions()):
            code = function.instruction_id(number)
            out = function.instruction_output(number)
            places = function.instruction_input(number)
            if code == ca.OP_OUTPUT:  # `out` is (result, entry)
                result[out[1]] = self.work[places[0]].value
            else:
                self.work[out[0]] = self._value(number, code, places)
        return result

    def arguments_of_blends(self) -> ca.SX:
        """Return the arguments of all nonsmooth points as a column, (blends,)."""
        return ca.densify(ca.vertcat(ca.SX(0, 1), *self.arguments))

    def _value(self, number: int, code: int, places: list[int]) -> _Value:
        """Return the value of an instruction from its operation and the places of its operands."""
        if code == ca.OP_CONST:
            return _Value(ca.SX(self.function.instruction_constant(number)))
        if code == ca.OP_INPUT:
            return _Value(self.symbol[places[1]])  # of an input, `places` is (argument, entry)
        if code == ca.OP_CALL:
            raise BadInputError(
                "the equations call a compiled function, such as an FMU, which the search for best "
                "flights does not support; use an aircraft with equations"
            )
        values = [self.work[place] for place in places]
        if code in _LOGIC:
            return _chosen(code, values)
        operands = [operand.value for operand in values]
        if code in _COMPARISONS:
            return self._compared(code, *operands)
        if code in _NONSMOOTH:
            return _Value(self._blended(code, *operands))
        return _Value(_applied(code, operands))

    def _compared(self, code: int, low: ca.SX, high: ca.SX) -> _Value:
        """Return the value of low < high or low <= high."""
        return self._next_blend(high - low).step(high - low, ca.SX.binary(code, low, high))

    def _blended(self, code: int, one: ca.SX, other: ca.SX | None = None) -> ca.SX:
        """Return the smoothed |one|, or smaller or larger one of two values."""
        if other is None:
            return self._next_blend(one).size(one)
        blend = self._next_blend(one - other)
        if blend.width == 0.0:
            return ca.SX.binary(code, one, other)
        half = 0.5 * blend.size(one - other)
        middle = 0.5 * (one + other)
        return middle + half if code == ca.OP_FMAX else middle - half

    def _next_blend(self, argument: ca.SX) -> _Blend:
        """Store the argument of a further nonsmooth point, and return its smoothing."""
        self.arguments.append(argument)
        # A first replay without blends only collects the arguments, from which the blends follow.
        return _Blend(0.0) if self.blends is None else self.blends[len(self.arguments) - 1]


def _applied(code: int, operands: list[ca.SX]) -> ca.SX:
    """Return the result of a CasADi operation with one or two operands."""
    if len(operands) == 1:
        return ca.SX.unary(code, operands[0])
    return ca.SX.binary(code, *operands)


def _chosen(code: int, values: list[_Value]) -> _Value:
    """Return the value of a logical operation, of truth values that may be smooth."""
    operands = [operand.value for operand in values]
    is_soft = [operand.is_soft for operand in values]
    if not any(is_soft) or (code == ca.OP_IF_ELSE_ZERO and not is_soft[0]):
        return _Value(_applied(code, operands))
    if code == ca.OP_NOT:
        return _Value(1.0 - operands[0], is_soft=True)
    a, b = operands  # with values 0 and 1, a b is "and", and a + b - a b is "or"
    if code == ca.OP_IF_ELSE_ZERO:  # the branch b that a selects, 0 otherwise
        if b.is_constant() and not np.isfinite(float(b)):  # 0 inf is not 0
            return _Value(ca.SX.binary(code, a >= 0.5, b))
        # With the branch 1, the result is a truth value again.
        return _Value(a * b, is_soft=b.is_constant() and float(b) == 1.0)
    return _Value(a * b if code == ca.OP_AND else a + b - a * b, is_soft=True)
