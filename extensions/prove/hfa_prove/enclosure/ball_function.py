"""Evaluation of CasADi functions on balls, one instruction at a time.

CasADi folds constants in doubles and stores 5 (0.2 x) as x. The proof covers the folded function,
which is also the function that is evaluated.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, islice
from operator import methodcaller
from typing import Any, NamedTuple

import casadi as ca
from flint import arb, fmpq

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls
from hfa_prove.enclosure.splines import Spline, Table, is_table, polynomial, tables_of
from hfa_support.errors import BadInputError, NoSolutionError

#: Relative radius about a double that contains the decimal from which it was read, also if it was
#: converted from degrees: four units of 2^-53.
READING = 2.0**-51


def exact(value: float) -> arb:
    """Return the ball of radius 0 whose midpoint is a double."""
    return arb(float(value))


def about_zero(radius: Any) -> arb:
    """Return [-r, r], with r an upper bound of the absolute value of a number or ball."""
    bound = abs(arb(radius)).upper()
    return (-bound).union(bound)


#: Largest number of operations of a function.
LARGEST = 100_000


class Undecided(NoSolutionError):
    """Raised if balls are too wide for a comparison or an enclosure.

    Narrower balls may suffice.
    """


def _is_less(a: Any, b: Any) -> bool:
    """Return whether a < b. Raises Undecided unless the order of the balls is proved."""
    if not (a < b or a >= b):
        raise Undecided(
            "fmin, fmax or another comparison switches within a box; use smooth equations, or "
            "a trim away from the switch"
        )
    return bool(a < b)


def _less(a: Any, b: Any) -> arb:
    """Return 1 for a < b, else 0."""
    return arb(int(_is_less(a, b)))


def _maximum(a: Any, b: Any) -> Any:
    """Return the larger of two balls. Raises Undecided unless their order is proved."""
    return b if _is_less(a, b) else a


def _minimum(a: Any, b: Any) -> Any:
    """Return the smaller of two balls. Raises Undecided unless their order is proved."""
    return a if _is_less(a, b) else b


def _atan2(a: Any, b: Any) -> Any:
    """Return atan2(a, b) = atan(a / b) for b > 0. Raises Undecided unless b is proved positive."""
    if not b > 0:
        raise Undecided("atan2(y, x) is undecided, because x is not proved positive")
    return (a / b).atan()


def _power(a: Any, b: Any) -> Any:
    """Return a^b = exp(b log a) for a > 0. Raises Undecided unless a is proved positive."""
    if not a > 0:
        raise Undecided("x^y is undecided, because x is not proved positive")
    return (b * a.log()).exp()


#: Operation of CasADi -> the operation on balls.
_OPERATIONS: Mapping[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_NEG: operator.neg,
    ca.OP_TWICE: lambda a: a + a,
    ca.OP_MUL: operator.mul,
    ca.OP_SQ: lambda a: a * a,
    ca.OP_DIV: operator.truediv,
    ca.OP_INV: lambda a: 1 / a,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_SQRT: methodcaller("sqrt"),
    ca.OP_EXP: methodcaller("exp"),
    ca.OP_EXPM1: methodcaller("expm1"),
    ca.OP_LOG: methodcaller("log"),
    ca.OP_LOG1P: methodcaller("log1p"),
    ca.OP_SIN: methodcaller("sin"),
    ca.OP_COS: methodcaller("cos"),
    ca.OP_TAN: methodcaller("tan"),
    ca.OP_ASIN: methodcaller("asin"),
    ca.OP_ACOS: methodcaller("acos"),
    ca.OP_ATAN: methodcaller("atan"),
    ca.OP_ATAN2: _atan2,
    ca.OP_TANH: methodcaller("tanh"),
    ca.OP_FMIN: _minimum,
    ca.OP_FMAX: _maximum,
    ca.OP_FABS: lambda a: _maximum(a, -a),
    ca.OP_SIGN: lambda a: _less(arb(0), a) - _less(a, arb(0)),
    ca.OP_LT: _less,
    ca.OP_LE: lambda a, b: 1 - _less(b, a),
    ca.OP_NOT: lambda a: 1 - a,
    ca.OP_AND: operator.mul,
    ca.OP_OR: lambda a, b: a + b - a * b,
    ca.OP_IF_ELSE_ZERO: operator.mul,
}


class _Step(NamedTuple):
    """Instruction of a function: a constant, or a function of the values at `sources`."""

    code: int
    operation: Any
    sources: Sequence[int]
    targets: Sequence[int]


class BallFunction:
    """A CasADi function, evaluated on balls (`flint.arb`).

    Constants of the function are the doubles that CasADi stores.

    function: the function
    name: name of the function for messages, or "" for the name in `function`

    Raises BadInputError with the name of the operation if an operation is not supported, or if the
    function is too large or contains a constant that is not finite.
    """

    def __init__(self, function: ca.Function, name: str = "") -> None:
        self._name = name or function.name()
        scalars = _in_scalars(function, self._name)
        count = scalars.n_instructions()
        if count > LARGEST:
            raise BadInputError(
                f"{self._name}: the function has {count} operations, but at most {LARGEST} are "
                "supported; simplify the function"
            )
        self.inputs = [scalars.nnz_in(index) for index in range(scalars.n_in())]
        self._outputs = [scalars.nnz_out(index) for index in range(scalars.n_out())]
        self._size = scalars.sz_w()
        self._steps = [self._step(scalars, index) for index in range(count)]

    def _step(self, scalars: ca.Function, index: int) -> _Step:
        """Return an instruction with its operation on balls."""
        code = scalars.instruction_id(index)
        operation: Any = None
        if code == ca.OP_CONST:
            operation = arb(self._finite(scalars.instruction_constant(index)))
        elif code == ca.OP_CALL:
            called = scalars.instructions_sx()[index].which_function()
            operation = _called(called, self._name)
        elif code in _OPERATIONS:
            operation = _OPERATIONS[code]
        elif code not in (ca.OP_INPUT, ca.OP_OUTPUT):
            raise _refusal(self._name, _operation_name(code))
        sources, targets = scalars.instruction_input(index), scalars.instruction_output(index)
        return _Step(code, operation, sources, targets)

    def _finite(self, value: float) -> float:
        """Return a constant of the function. Raises BadInputError unless it is finite."""
        if not math.isfinite(value):
            raise BadInputError(f"{self._name}: the function contains {value}; use finite numbers")
        return value

    def __call__(self, *arguments: Sequence[Any]) -> list[list[Any]]:
        """Return the outputs, each as a list of its nonzeros in CasADi's order (column by column).

        arguments: nonzeros of each input, in CasADi's order

        A value that is not defined on the whole box is nan, for which no comparison is true.

        Raises Undecided if a comparison is not decided on the box. Raises ValueError if an argument
        has the wrong number of entries.
        """
        if [len(argument) for argument in arguments] != self.inputs:
            raise ValueError(f"the arguments of {self._name} must have {self.inputs} entries")
        work: list[Any] = [None] * self._size
        results: list[list[Any]] = [[None] * size for size in self._outputs]
        for code, operation, sources, targets in self._steps:
            if code == ca.OP_CONST:
                work[targets[0]] = operation
            elif code == ca.OP_INPUT:
                work[targets[0]] = arguments[sources[0]][sources[1]]
            elif code == ca.OP_OUTPUT:
                results[targets[0]][targets[1]] = work[sources[0]]
            elif code == ca.OP_CALL:
                values = operation(*(work[source] for source in sources))
                for target, value in zip(targets, values, strict=True):
                    if target >= 0:  # -1: the value is not used
                        work[target] = value
            else:
                work[targets[0]] = operation(*(work[source] for source in sources))
        return results


def _in_scalars(function: ca.Function, name: str) -> ca.Function:
    """Return a function as an SX function. Raises BadInputError if CasADi cannot expand it."""
    if not function.is_a("MXFunction"):
        return function
    try:
        return function.expand()
    except RuntimeError as error:
        raise BadInputError(
            f"{name}: the proof needs {function.name()}, a derivative of a smooth table, whose "
            "coefficients CasADi rounds; use the method 'linear' of casadi.interpolant"
        ) from error


def _called(function: ca.Function, name: str) -> Callable[..., Sequence[Any]]:
    """Return the operation of a call, nonzeros of all arguments -> those of all results."""
    if is_table(function):
        tables = tables_of(function)
        return lambda *values: [_of_table(table, values) for table in tables]
    if not function.is_a("SXFunction") and not function.is_a("MXFunction"):
        raise _refusal(name, f"the function {function.name()}")
    on_balls = BallFunction(function, name)

    def call(*values: Any) -> list[Any]:
        remaining = iter(values)
        arguments = [list(islice(remaining, size)) for size in on_balls.inputs]
        return list(chain.from_iterable(on_balls(*arguments)))

    return call


def _of_table(table: Table, values: Sequence[Any]) -> Any:
    """Return the value of a table at balls a_d, Σ_I c_I Π_d φ_(d, I_d)(a_d), layer by layer."""
    if len(values) == 1:
        return _of_spline(table.spline(), values[0])
    parts = (
        _of_spline(spline, values[-1]) * _of_table(inner, values[:-1])
        for spline, inner in table.layers()
    )
    return sum(parts, arb(0))


def _of_spline(spline: Spline, a: Any) -> Any:
    """Return the value of the piece of a table that is proved to contain a."""
    # Two pieces agree at a knot without a jump: either may be used there.
    ends = [-arb("inf"), *map(arb, spline.knots), arb("inf")]
    is_jump = [False, *spline.has_jumps, False]
    for k, piece in enumerate(spline.pieces):
        above = a > ends[k] if is_jump[k] else a >= ends[k]
        below = a < ends[k + 1] if is_jump[k + 1] else a <= ends[k + 1]
        if above and below:
            coefficients = tuple(arb(fmpq(c.numerator, c.denominator)) for c in piece)
            return polynomial(coefficients, a - arb(spline.origins[k]))
    raise Undecided("a table of the equations has a breakpoint within a box")


def _refusal(name: str, what: str) -> BadInputError:
    """Return the error that a proof does not support what the equations use."""
    return BadInputError(
        f"{name}: the equations use {what}, which a proof does not support; use sums, products, "
        "quotients, powers, roots, exp, log, tanh, sin, cos, tan, asin, acos, atan, atan2, min, "
        "max, abs, conditions and tables of casadi.interpolant"
    )


def _operation_name(code: int) -> str:
    """Return the lower-case name of a CasADi operation code, or the code if it has no name."""
    for name in dir(ca):
        if name.startswith("OP_") and getattr(ca, name) == code:
            return name.removeprefix("OP_").lower()
    return str(code)
