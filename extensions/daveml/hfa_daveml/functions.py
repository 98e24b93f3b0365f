"""Variables of a DAVE-ML file as CasADi expressions of the inputs."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from functools import reduce
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.tables import Interpolator
from hfa_daveml.document import Document, Variable
from hfa_support.errors import BadInputError, shortened

if TYPE_CHECKING:
    from xml.etree import ElementTree


#: Operators of one argument.
_UNARY: Mapping[str, Callable[[Any], Any]] = {
    "abs": ca.fabs,
    "floor": ca.floor,
    "ceiling": ca.ceil,
    "exp": ca.exp,
    "ln": ca.log,
    "log": ca.log10,
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "arcsin": ca.asin,
    "arccos": ca.acos,
    "arctan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "not": ca.logic_not,
}
#: Operators of two arguments.
_BINARY: Mapping[str, Callable[[Any, Any], Any]] = {
    "divide": operator.truediv,
    "power": operator.pow,
    "lt": operator.lt,
    "gt": operator.gt,
    "leq": operator.le,
    "geq": operator.ge,
    "eq": ca.eq,
    "neq": ca.ne,
    "atan2": ca.atan2,
}
#: Operators of any number of arguments.
_VARIADIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "plus": operator.add,
    "times": operator.mul,
    "min": ca.fmin,
    "max": ca.fmax,
    "and": ca.logic_and,
    "or": ca.logic_or,
}
_CONSTANTS = {"pi": math.pi, "exponentiale": math.e, "true": 1.0, "false": 0.0}


def expression(element: ElementTree.Element, value_of: Callable[[str], Any]) -> Any:
    """Return a formula as a CasADi expression or a number.

    value_of: varID -> value of the variable

    Raises BadInputError if an element is not supported, an operator has a wrong number of
    arguments, the value of an operator of numbers is not a finite number, or a number or a
    piecewise element is invalid.
    """
    if element.tag == "ci":
        return value_of((element.text or "").strip())
    if element.tag == "cn":
        return _number(element)
    if element.tag in _CONSTANTS:
        return _CONSTANTS[element.tag]
    if element.tag == "piecewise":
        return _piecewise(element, value_of)
    if element.tag == "apply" and len(element):
        operator_element, *arguments = element
        if not arguments and operator_element.tag in ("apply", "piecewise", "ci", "cn"):
            return expression(operator_element, value_of)  # a formula in brackets
        return _finite_result(
            operator_element, [expression(argument, value_of) for argument in arguments]
        )
    raise BadInputError(
        f"<{shortened(element.tag)}> is not supported in a formula; rewrite the formula"
    )


def _finite_result(element: ElementTree.Element, arguments: list[Any]) -> Any:
    """Return the result of an operator. Raises BadInputError if that of numbers is not finite."""
    try:
        result = _result_of_operator(element, arguments)
        is_finite = not isinstance(result, complex)  # as Python's (-8) ** 0.5
        if is_finite and all(isinstance(argument, int | float) for argument in arguments):
            is_finite = math.isfinite(result)
    except ArithmeticError:  # division by zero, or an overflow
        is_finite = False
    if not is_finite:
        numbers = ", ".join(f"{argument:g}" for argument in arguments)
        raise BadInputError(
            f"<{shortened(element.tag)}> of {numbers} is not a finite number; correct the formula"
        )
    return result


def _result_of_operator(element: ElementTree.Element, arguments: list[Any]) -> Any:
    """Return the result of the operator that an element names, applied to arguments."""
    name = element.tag
    if name == "csymbol":
        name = (element.text or "").strip()
    count = len(arguments)
    if name == "minus" and count in (1, 2):
        return -arguments[0] if count == 1 else arguments[0] - arguments[1]
    if name == "root" and count == 1:
        return ca.sqrt(arguments[0])
    if name in _UNARY and count == 1:
        return _UNARY[name](arguments[0])
    if name in _BINARY and count == 2:
        return _BINARY[name](*arguments)
    if name in _VARIADIC and count >= 1:
        return reduce(_VARIADIC[name], arguments)
    if name not in ("minus", "root", *_UNARY, *_BINARY, *_VARIADIC):
        raise BadInputError(
            f"<{shortened(name)}> is not supported in a formula; rewrite the formula"
        )
    raise BadInputError(
        f"the number of arguments of <{shortened(name)}> is {count}, which is not supported; "
        "rewrite the formula"
    )


def _number(element: ElementTree.Element) -> float:
    """Return the number in a <cn> element. Raises BadInputError if its text is no number."""
    try:
        if element.get("type") == "e-notation":  # 1.5<sep/>-3
            mantissa = (element.text or "").strip()
            exponent = (element[0].tail or "").strip()
            return float(f"{float(mantissa)}e{int(exponent)}")
        return float((element.text or "").strip())
    except (ValueError, IndexError) as error:
        raise BadInputError(
            f"<cn> contains {shortened(element.text or '')!r}, which is not a number; give a number"
        ) from error


def _piecewise(element: ElementTree.Element, value_of: Callable[[str], Any]) -> Any:
    """Return the value of the first piece whose condition is true, else that of <otherwise>."""
    otherwise = element.find("otherwise")
    if otherwise is None or len(otherwise) != 1:
        raise BadInputError(
            "<piecewise> does not contain one <otherwise> with one value; add the value for all "
            "other cases"
        )
    value = expression(otherwise[0], value_of)
    # From the last piece to the first, which is tested first of all.
    for piece in reversed(element.findall("piece")):
        if len(piece) != 2:
            raise BadInputError(
                "<piece> does not contain a value and a condition; add the missing element"
            )
        chosen, condition = (expression(part, value_of) for part in piece)
        value = ca.if_else(condition, chosen, value)
    return value


class Expressions:
    """Values of the variables of a document, each computed once, at its first use.

    The first of these values that exists is used, clipped to the limits of the variable:

    - the given value,
    - the value of a table or formula,
    - the initial value.
    """

    def __init__(self, document: Document, given: Mapping[str, Any], table: Interpolator) -> None:
        """Store the given values, clipped to the limits of the variables.

        given: varID -> value in the file's units
        table: interpolator shared by the files of an aircraft
        """
        self._document = document
        self._values = {
            key: _clipped(value, document.variables[key].least, document.variables[key].most)
            for key, value in given.items()
        }
        self._table = table
        #: Variables that are being computed, each by its varID; an earlier one requires the next.
        self._pending: list[str] = []

    def __getitem__(self, key: str) -> Any:
        """Return the value of the variable with this varID, in the file's units.

        Raises BadInputError if the variable, or a variable on which it depends, is not defined, has
        no value, depends on itself or has an invalid or too deeply nested formula.
        """
        if key in self._values:
            return self._values[key]
        variable = self._document.variables.get(key)
        if variable is None:
            requiring = self._pending[-1] if self._pending else key
            raise self._document.error(
                f"variable {requiring}", f"variable {key} is not defined; add a <variableDef>"
            )
        if key in self._pending:
            circle = ", ".join(self._pending[self._pending.index(key) :])
            raise self._document.error(
                f"variable {key}",
                f"the definition of the variable is circular ({circle}); remove the circular "
                "dependence",
            )
        self._pending.append(key)
        try:
            self._values[key] = _clipped(self._value(variable), variable.least, variable.most)
        except RecursionError as error:
            raise self._document.error(
                f"variable {key}", "the formula is nested too deeply; use further variables"
            ) from error
        finally:
            self._pending.pop()
        return self._values[key]

    def _value(self, variable: Variable) -> Any:
        """Return the value of the table, of the formula, or the initial value of a variable."""
        function = self._document.functions.get(variable.key)
        if function is not None:
            arguments = [_clipped(self[axis.key], axis.least, axis.most) for axis in function.axes]
            return function.table.value(arguments, self._table)
        if variable.formula is not None:
            try:
                return expression(variable.formula, self.__getitem__)
            except BadInputError as error:
                if str(error).startswith(self._document.path):
                    raise  # of another variable, which the message names
                raise self._document.error(f"variable {variable.key}", str(error)) from error
        if variable.initial is None:
            raise self._document.error(
                f"variable {variable.key}",
                "the variable has no table, formula or initial value; add the attribute "
                "initialValue",
            )
        return variable.initial


def _clipped(value: Any, least: float, most: float) -> Any:
    """Return a value, clipped to limits that may be infinite."""
    if np.isfinite(least):
        value = ca.fmax(value, least)
    if np.isfinite(most):
        value = ca.fmin(value, most)
    return value
