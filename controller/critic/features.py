"""Basis functions of weights: by name, or listed as formulas, which are not executed as Python."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from typing import Any

import casadi as ca

from controller.game.basis import Basis, basis as named_basis
from hfa_support.errors import BadInputError, is_finite, prefix_errors, shortened

#: Functions that the text may contain.
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    **{name: getattr(ca, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")},
    **{name: getattr(ca, name) for name in ("tanh", "exp", "log", "sqrt", "fabs")},
    **{"abs": ca.fabs, "min": ca.fmin, "max": ca.fmax},
}
#: Words that are not names of symbols.
RESERVED = tuple(_FUNCTIONS)
_OPERATIONS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_SIGNS: Mapping[type, Callable[[Any], Any]] = {ast.USub: operator.neg, ast.UAdd: operator.pos}
#: Characters of a list of formulas that are read.
_MOST_CHARACTERS = 20_000


def basis_of(
    basis: Basis | ca.Function | str | list[str], states: int, names: tuple[str, ...]
) -> Basis | ca.Function:
    """Return the functions ψ of weights. A basis or a CasADi Function is returned unchanged.

    basis: also the name of a basis, or formulas (`listed_functions`), as a text or a list
    states: n
    names: names of the states, for a list of formulas

    Raises BadInputError for an unknown name, and for a faulty list.
    """
    if isinstance(basis, list):
        basis = ", ".join(map(str, basis))
    if not isinstance(basis, str):
        return basis
    if is_list(basis):
        return listed_functions(basis, states, names)
    return named_basis(basis, states)


def is_list(basis: str) -> bool:
    """Return whether a text is a list of formulas, and not the name of a basis.

    A name consists of small letters and +. Any other character, such as a comma, makes a list.
    """
    return re.search(r"[^a-z+]", basis) is not None


def listed_functions(text: str, states: int, names: tuple[str, ...] = ()) -> ca.Function:
    """Return the CasADi Function z (n,) -> values of the functions in a list of formulas.

    text: a list such as "x1**2, x1*x2, sin(alpha)". The expressions may contain numbers, x1 ... xn,
        the names of the states, + - * / **, and the functions in `_FUNCTIONS`.
    states: n
    names: names of the states

    Raises BadInputError for any other content.
    """
    z = ca.SX.sym("z", states)
    symbols = {f"x{index + 1}": z[index] for index in range(states)}
    symbols |= {name: z[index] for index, name in enumerate(names)}
    with prefix_errors("basis"):
        try:
            functions = expressions(text, symbols, f"x1 to x{states}")
            return ca.Function("basis", [z], [ca.densify(ca.vertcat(*functions))])
        except BadInputError:
            raise
        except Exception as error:  # each raises other exceptions: parser, floats, CasADi
            raise BadInputError(
                f"{shortened(text)!r} is not a list of expressions, such as 'x1**2, x1*x2'"
            ) from error


def expressions(text: str, symbols: Mapping[str, ca.SX], known: str) -> list[ca.SX]:
    """Return the CasADi expressions of a list of formulas.

    text: formulas, separated by commas; only the first `_MOST_CHARACTERS` characters are read
    symbols: name -> symbol
    known: text with the permitted names, for an error message

    Raises BadInputError for an unknown name or operation, and SyntaxError for text that is not a
    formula.
    """
    tree = ast.parse(f"({text[:_MOST_CHARACTERS]},)", mode="eval").body
    assert isinstance(tree, ast.Tuple)  # because of the comma
    return [_expression(node, symbols, known) for node in tree.elts]


def _expression(node: ast.AST, symbols: Mapping[str, ca.SX], known: str) -> ca.SX:
    """Return the CasADi expression of one node of the Python syntax tree of a formula."""
    match node:
        case ast.Constant(value=bool()):  # is an int
            pass
        case ast.Constant(value=int() | float() as number) if is_finite(number):
            return ca.SX(float(number))
        case ast.Name(id=name) if name in symbols:
            return symbols[name]
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _OPERATIONS:
            combine = _OPERATIONS[type(operation)]
            return combine(_expression(left, symbols, known), _expression(right, symbols, known))
        case ast.UnaryOp(op=sign, operand=operand) if type(sign) in _SIGNS:
            return _SIGNS[type(sign)](_expression(operand, symbols, known))
        case ast.Call(func=ast.Name(id=name), args=arguments) if name in _FUNCTIONS:
            return _FUNCTIONS[name](*(_expression(part, symbols, known) for part in arguments))
    raise BadInputError(
        f"{shortened(ast.unparse(node))!r} is not supported; use {known}, + - * / ** and "
        f"{', '.join(_FUNCTIONS)}"
    )


def blocks_in_order(
    names_or_blocks: tuple[str, ...], blocks: dict[str, tuple[str, ...]]
) -> list[int]:
    """Return the places in H of the signals of a plant, block by block.

    names_or_blocks: H_signals of a file: names of the signals of H, or of its blocks, in its order
    blocks: block, such as "x" -> names of its signals, in the order of the plant. Blocks that H
        lacks are left out

    Raises BadInputError for other names.

    >>> blocks_in_order(("u", "beta", "alpha"), {"x": ("alpha", "beta"), "u": ("e",)})
    [2, 1, 0]
    """
    in_matrix = [signal for word in names_or_blocks for signal in blocks.get(word, (word,))]
    present = [signals for signals in blocks.values() if set(signals) & set(in_matrix)]
    in_plant = list(chain.from_iterable(present))
    if sorted(in_matrix) != sorted(in_plant):
        signals = ", ".join(chain.from_iterable(blocks.values()))
        raise BadInputError(
            f"H_signals lists {shortened(', '.join(names_or_blocks), 200)}; give the blocks "
            f"{', '.join(blocks)}, or their signals ({shortened(signals, 200)}), each of them once"
        )
    return [in_matrix.index(signal) for signal in in_plant]


def symbols_for(functions: Iterable[ca.Function], n: int) -> ca.SX:
    """Return new CasADi symbols z (n,), as arguments of all given functions.

    The symbols are of type SX if all functions are SX functions, and otherwise of type MX.
    Evaluation of a wide network with SX symbols would take a minute and a gigabyte.
    """
    if all(function.is_a("SXFunction") for function in functions):
        return ca.SX.sym("z", n)
    return ca.MX.sym("z", n)  # type: ignore[return-value]  # has the same operators
