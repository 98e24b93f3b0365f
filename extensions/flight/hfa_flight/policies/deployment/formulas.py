"""Formulas of a deployment file as CasADi expressions.

A formula consists of numbers, names, + - * / ** and a few functions.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import casadi as ca

from hfa_support.errors import BadInputError, refuse_unknown, shown

_LONGEST = 500
_FUNCTIONS: Mapping[str, tuple[int, Callable[..., Any]]] = {
    "sin": (1, ca.sin),
    "cos": (1, ca.cos),
    "tan": (1, ca.tan),
    "asin": (1, ca.asin),
    "acos": (1, ca.acos),
    "atan": (1, ca.atan),
    "atan2": (2, ca.atan2),
    "tanh": (1, ca.tanh),
    "sqrt": (1, ca.sqrt),
    "exp": (1, ca.exp),
    "log": (1, ca.log),
    "abs": (1, ca.fabs),
    "min": (2, ca.fmin),
    "max": (2, ca.fmax),
}
_OPERATORS: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_CONSTANTS = {"pi": math.pi}
_RULE = "use only numbers, names, + - * / ** and " + ", ".join(_FUNCTIONS)


class Formula(NamedTuple):
    """Parsed formula of supported operations, never executed as Python code.

    text: the formula as written.
    tree: syntax tree of the formula.
    names: variables of the formula, in order of appearance.
    """

    text: str
    tree: ast.expr
    names: tuple[str, ...]

    def value(self, values: Mapping[str, Any]) -> ca.SX:
        """Return the expression of the formula.

        values: name -> value
        """
        return ca.SX(_value(self.tree, values))


def read_formula(text: Any, known: tuple[str, ...]) -> Formula:
    """Parse a formula.

    known: permitted names

    Raises BadInputError for an unknown name, an unsupported operation, a text longer than
    `_LONGEST` characters, and for anything that is not a formula.
    """
    if not isinstance(text, str) or len(text) > _LONGEST:
        raise BadInputError(
            f"{shown(text)} is too long for a formula; give at most {_LONGEST} characters"
        )
    try:
        tree = ast.parse(text.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise BadInputError(f"{shown(text)} is not a formula; {_RULE}") from error
    names: list[str] = []
    _check(tree, text, (*known, *_CONSTANTS), names)
    taken = [name for name in names if name not in _CONSTANTS]
    return Formula(text, tree, tuple(dict.fromkeys(taken)))


def _check(node: ast.expr, text: str, known: tuple[str, ...], names: list[str]) -> None:
    """Check the syntax tree of a formula, and append the names that it contains to `names`."""
    if isinstance(node, ast.Name):
        refuse_unknown(f"the formula {shown(text)} contains the unknown name", node.id, known)
        names.append(node.id)
        return
    if isinstance(node, ast.Constant):
        _check_number(node.value, text)
        return
    parts: list[ast.expr] = []
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        parts = [node.operand]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        refuse_unknown(f"the formula {shown(text)} calls", node.func.id, _FUNCTIONS)
        count, _ = _FUNCTIONS[node.func.id]
        if len(node.args) != count:
            raise BadInputError(
                f"the formula {shown(text)}: the number of arguments of {node.func.id} is "
                f"{len(node.args)}; give {count}"
            )
        parts = node.args
    else:
        raise BadInputError(f"the formula {shown(text)} contains an unsupported operation; {_RULE}")
    for part in parts:
        _check(part, text, known, names)


def _check_number(value: Any, text: str) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise BadInputError(
            f"the formula {shown(text)} contains {shown(value)}, which is not supported; {_RULE}"
        )
    try:
        is_number = math.isfinite(value)
    except OverflowError:
        is_number = False
    if not is_number:
        raise BadInputError(
            f"the formula {shown(text)} contains a number that is not finite; give a finite number"
        )


def _value(node: ast.expr, values: Mapping[str, Any]) -> Any:
    """Return the value of a formula's syntax tree as a CasADi expression."""
    if isinstance(node, ast.Name):
        return values[node.id] if node.id in values else ca.SX(_CONSTANTS[node.id])
    if isinstance(node, ast.Constant):
        return ca.SX(float(node.value))  # type: ignore[arg-type]  # checked to be a number
    if isinstance(node, ast.BinOp):
        sides = (_value(node.left, values), _value(node.right, values))
        return _OPERATORS[type(node.op)](*sides)
    if isinstance(node, ast.UnaryOp):
        operand = _value(node.operand, values)
        return -operand if isinstance(node.op, ast.USub) else operand
    assert isinstance(node, ast.Call)  # the syntax was checked
    assert isinstance(node.func, ast.Name)  # as above
    _, function = _FUNCTIONS[node.func.id]
    return function(*(_value(argument, values) for argument in node.args))
