"""Evaluation of CasADi functions on balls, series and Taylor models, one instruction at a time."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
from flint import arb, arb_series

import verification.enclosure.precision  # noqa: F401  # sets the precision of balls
from hfa_support.errors import BadInputError, NoSolutionError
from verification.enclosure.program import operation_name


class Undecided(NoSolutionError):
    """Raised if balls are too wide for a comparison or an enclosure.

    Narrower balls may suffice.
    """


class BallFunction:
    """A CasADi `SX` function, evaluated on `flint.arb`, `flint.arb_series` and Taylor models.

    An `arb_series` is a Taylor polynomial in one variable. Its evaluation also computes
    derivatives. Constants of the function are the doubles that CasADi stores.

    function: the function
    name: name of the function for messages, or "" for the name in `function`

    Raises BadInputError with the name of the operation if an operation is not supported.
    """

    def __init__(self, function: ca.Function, name: str = "") -> None:
        self._name = name or function.name()
        self._size = function.sz_w()
        self._sizes = [function.nnz_out(index) for index in range(function.n_out())]
        self._inputs = [function.nnz_in(index) for index in range(function.n_in())]
        self._steps: list[tuple[int, Any, list[int], list[int]]] = []
        for index in range(function.n_instructions()):
            code = function.instruction_id(index)
            operation: Any = None
            if code == ca.OP_CONST:
                operation = arb(function.instruction_constant(index))
            elif code not in (ca.OP_INPUT, ca.OP_OUTPUT):
                operation = _operation(code, self._name)
            targets = function.instruction_output(index)
            sources = function.instruction_input(index)
            self._steps.append((code, operation, targets, sources))

    def __call__(self, *arguments: Sequence[Any]) -> list[list[Any]]:
        """Return the outputs, each as a list of its nonzeros in CasADi's order (column by column).

        arguments: nonzeros of each input, in CasADi's order

        Raises Undecided if a division, a root or a comparison is not decided on the box. Raises
        ValueError if an argument has the wrong number of entries.
        """
        if [len(argument) for argument in arguments] != self._inputs:
            raise ValueError(f"the arguments of {self._name} must have {self._inputs} entries")
        try:
            return self._run(arguments)
        except (ValueError, ZeroDivisionError) as error:
            # A divisor or a root may be 0 on this box.
            raise Undecided(
                f"{self._name} is not proved to be defined on the whole box ({error})"
            ) from error

    def _run(self, arguments: Sequence[Sequence[Any]]) -> list[list[Any]]:
        """Return the outputs for given nonzeros of each input."""
        work: list[Any] = [None] * self._size
        results: list[list[Any]] = [[None] * size for size in self._sizes]
        for code, operation, target, source in self._steps:
            if code == ca.OP_CONST:
                work[target[0]] = operation
            elif code == ca.OP_INPUT:
                work[target[0]] = arguments[source[0]][source[1]]
            elif code == ca.OP_OUTPUT:
                results[target[0]][target[1]] = work[source[0]]
            elif len(source) == 1:
                work[target[0]] = operation(work[source[0]])
            else:
                work[target[0]] = operation(work[source[0]], work[source[1]])
        return results


def _operation(code: int, name: str) -> Callable[..., Any]:
    """Return the operation on balls for a CasADi operation code.

    code: `ca.OP_...`
    name: name of the function, for the message

    Raises BadInputError with the name of the operation if the operation is not supported.
    """
    if code in _OPERATIONS:
        return _OPERATIONS[code]
    raise BadInputError(
        f"{name}: the equations use {operation_name(code)}, which a proof does not support; "
        "replace tables and switches by polynomials"
    )


def constant_part(value: Any) -> Any:
    """Return a ball for a value.

    - ball: the ball itself
    - series: the constant term
    - Taylor model: the range
    """
    if isinstance(value, arb):
        return value
    if isinstance(value, arb_series):
        return value[0]
    return value.range()


def _sorted(x: Any, y: Any) -> tuple[Any, Any]:
    """Return the smaller and the larger of two values.

    Raises Undecided unless the order of their balls is proved.
    """
    first = constant_part(x)
    second = constant_part(y)
    if not (first <= second or first > second):
        raise Undecided(
            "fmin, fmax or another comparison switches within a box; use smooth equations, or a "
            "trim away from the switch"
        )
    return (x, y) if first <= second else (y, x)


def _arctangent(y: Any, x: Any) -> Any:
    """Return atan2(y, x) = atan(y / x) for x > 0.

    Raises Undecided unless x is proved positive.
    """
    if not constant_part(x) > 0:
        raise Undecided("atan2(y, x) is undecided, because x is not proved positive")
    return (y / x).atan()


def _power(x: Any, y: Any) -> Any:
    """Return x^y = exp(y log x) for x > 0.

    Raises Undecided unless x is proved positive.
    """
    if not constant_part(x) > 0:
        raise Undecided("x^y is undecided, because x is not proved positive")
    return (y * x.log()).exp()


_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda x: x,
    ca.OP_ADD: operator.add,
    ca.OP_SUB: operator.sub,
    ca.OP_MUL: operator.mul,
    ca.OP_DIV: operator.truediv,
    ca.OP_NEG: operator.neg,
    ca.OP_TWICE: lambda x: x + x,
    ca.OP_SQ: lambda x: x * x,
    ca.OP_INV: lambda x: 1 / x,
    ca.OP_SQRT: lambda x: x.sqrt(),
    ca.OP_EXP: lambda x: x.exp(),
    ca.OP_LOG: lambda x: x.log(),
    ca.OP_SIN: lambda x: x.sin(),
    ca.OP_COS: lambda x: x.cos(),
    ca.OP_TAN: lambda x: x.tan(),
    ca.OP_ASIN: lambda x: x.asin(),
    ca.OP_ACOS: lambda x: x.acos(),
    ca.OP_ATAN: lambda x: x.atan(),
    ca.OP_ATAN2: _arctangent,
    ca.OP_POW: _power,
    ca.OP_CONSTPOW: _power,
    ca.OP_FMIN: lambda x, y: _sorted(x, y)[0],
    ca.OP_FMAX: lambda x, y: _sorted(x, y)[1],
    ca.OP_LE: lambda x, y: arb(int(_sorted(x, y)[0] is x)),
}
