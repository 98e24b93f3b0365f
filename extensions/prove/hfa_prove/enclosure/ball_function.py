"""Evaluation of CasADi functions on balls, one instruction at a time."""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
from flint import arb, fmpq

import hfa_prove.enclosure.precision  # noqa: F401  # sets the precision of balls
from hfa_prove.enclosure.program import Arithmetic, Reading
from hfa_prove.enclosure.splines import Spline
from hfa_support.errors import NoSolutionError


class Undecided(NoSolutionError):
    """Raised if balls are too wide for a comparison or an enclosure.

    Narrower balls may suffice.
    """


class BallFunction:
    """A CasADi function, evaluated on balls (`flint.arb`).

    Constants of the function are the doubles that CasADi stores.

    function: the function
    name: name of the function for messages, or "" for the name in `function`

    Raises BadInputError with the name of the operation if an operation is not supported.
    """

    def __init__(self, function: ca.Function, name: str = "") -> None:
        self._reading = Reading(function, Balls(), name or function.name())

    def __call__(self, *arguments: Sequence[Any]) -> list[list[Any]]:
        """Return the outputs, each as a list of its nonzeros in CasADi's order (column by column).

        arguments: nonzeros of each input, in CasADi's order

        A value that is not defined on the whole box is nan, for which no comparison is true.

        Raises Undecided if a comparison is not decided on the box. Raises ValueError if an argument
        has the wrong number of entries.
        """
        return self._reading(*arguments)


def _method(name: str) -> Callable[[Any, Any], Any]:
    """Return the operation that calls a method of a ball."""
    return lambda balls, value: getattr(value, name)()


class Balls(Arithmetic):
    """Arithmetic of balls.

    A comparison raises Undecided unless the order of the values is proved.
    """

    constant = staticmethod(arb)
    add = staticmethod(operator.add)
    subtract = staticmethod(operator.sub)
    negative = staticmethod(operator.neg)
    multiply = staticmethod(operator.mul)
    sqrt = _method("sqrt")
    exp = _method("exp")
    log = _method("log")
    sin = _method("sin")
    cos = _method("cos")
    atan = _method("atan")
    tanh = _method("tanh")

    def divide(self, a: Any, b: Any) -> Any:
        """Return a / b."""
        return a / b

    def tan(self, a: Any) -> Any:
        """Return tan a."""
        return a.tan()

    def asin(self, a: Any) -> Any:
        """Return asin a."""
        return a.asin()

    def acos(self, a: Any) -> Any:
        """Return acos a."""
        return a.acos()

    def inverse(self, a: Any) -> Any:
        """Return 1 / a."""
        return 1 / a

    def maximum(self, a: Any, b: Any) -> Any:
        """Return the larger value."""
        return b if self._is_less(a, b) else a

    def minimum(self, a: Any, b: Any) -> Any:
        """Return the smaller value."""
        return a if self._is_less(a, b) else b

    def less(self, a: Any, b: Any) -> Any:
        """Return 1 for a < b, else 0."""
        return arb(int(self._is_less(a, b)))

    def _is_less(self, a: Any, b: Any) -> bool:
        """Return whether a < b.

        Raises Undecided unless the order of the balls is proved.
        """
        if not (a < b or a >= b):
            raise Undecided(
                "fmin, fmax or another comparison switches within a box; use smooth equations, or "
                "a trim away from the switch"
            )
        return bool(a < b)

    def atan2(self, a: Any, b: Any) -> Any:
        """Return atan2(a, b) = atan(a / b) for b > 0.

        Raises Undecided unless b is proved positive.
        """
        if not b > 0:
            raise Undecided("atan2(y, x) is undecided, because x is not proved positive")
        return (a / b).atan()

    def power(self, a: Any, b: Any) -> Any:
        """Return a^b = exp(b log a) for a > 0.

        Raises Undecided unless a is proved positive.
        """
        if not a > 0:
            raise Undecided("x^y is undecided, because x is not proved positive")
        return (b * a.log()).exp()

    def table(self, spline: Spline, a: Any) -> Any:
        """Return the value of the piece of a table that contains a.

        Raises Undecided unless one piece is proved to contain it, without an end with a jump.
        """
        ball = a
        ends = [-arb("inf"), *map(arb, spline.knots), arb("inf")]
        is_jump = [False, *(spline.smoothness < 0).tolist(), False]
        for k, piece in enumerate(spline.pieces):
            above = ball > ends[k] if is_jump[k] else ball >= ends[k]
            below = ball < ends[k + 1] if is_jump[k + 1] else ball <= ends[k + 1]
            if above and below:
                d = a - arb(float(spline.origins[k]))
                value = 0 * d
                for coefficient in reversed(piece):
                    value = d * value + arb(fmpq(coefficient.numerator, coefficient.denominator))
                return value
        raise Undecided("a table of the equations has a breakpoint within a box")
