"""Functions of the state written as text, for the weights of a critic."""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from hfa_support.errors import BadInputError, shortened

#: What the text may call and do, and its most letters.
_FUNCTIONS = ("sin", "cos", "tan", "tanh", "exp", "log", "sqrt", "fabs")
_OPERATIONS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: Mapping[type, Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos}
_LONGEST = 20_000


def features_of(text: str, states: int, names: tuple[str, ...] = ()) -> ca.Function:
    """z (n,) -> the functions of a list such as "x1**2, x1*x2, sin(alpha)".

    The list may hold numbers, x1 ... xn or the names of the states, + - * / **, and the functions
    in `_FUNCTIONS`. Nothing is executed. BadInputError, one line, names anything else.
    """
    z = ca.SX.sym("z", states)
    symbols = {f"x{index + 1}": z[index] for index in range(states)}
    symbols |= {name: z[index] for index, name in enumerate(names)}
    try:
        tree = ast.parse(f"({text[:_LONGEST]},)", mode="eval").body
        assert isinstance(tree, ast.Tuple)
        features = [_expression(node, symbols, states) for node in tree.elts]
        return ca.Function("features", [z], [ca.densify(ca.vertcat(*features))])
    except BadInputError:
        raise
    except Exception as error:  # the parser, Python's floats and CasADi each have their own
        raise BadInputError(
            f"features: {shortened(text)!r} is no list of expressions, as in 'x1**2, x1*x2'"
        ) from error


def _expression(node: ast.AST, symbols: Mapping[str, ca.SX], states: int) -> ca.SX:
    """The CasADi expression of one node of the syntax tree."""
    match node:
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return ca.SX(float(number))
        case ast.Name(id=name) if name in symbols:
            return symbols[name]
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _OPERATIONS:
            combine = _OPERATIONS[type(operation)]
            return combine(_expression(left, symbols, states), _expression(right, symbols, states))
        case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _SIGNS:
            return _SIGNS[type(sign)](_expression(operand, symbols, states))
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in _FUNCTIONS:
            return getattr(ca, name)(*(_expression(part, symbols, states) for part in arguments))
    raise BadInputError(
        f"features: {shortened(ast.unparse(node))!r} is not known; use x1 to x{states}, "
        f"+ - * / ** and {', '.join(_FUNCTIONS)}"
    )
