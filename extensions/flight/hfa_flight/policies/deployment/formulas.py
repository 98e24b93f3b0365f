"""Formulas of a deployment file as CasADi expressions."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

import casadi as ca

from controller.critic.features import RESERVED, expressions
from hfa_support.errors import BadInputError, refuse_unknown, shown

_LONGEST = 500
#: A name in a formula, and not the exponent of a number.
_NAME = r"\b[A-Za-z_]\w*"


class Formula(NamedTuple):
    """Formula of numbers, names, + - * / ** and a few functions, never executed as Python code.

    names: variables of the formula.
    function: CasADi function of the variables.
    """

    names: tuple[str, ...]
    function: ca.Function

    def value(self, values: Mapping[str, Any]) -> ca.SX:
        """Return the expression of the formula.

        values: name -> value
        """
        return self.function.call([ca.SX(values[name]) for name in self.names])[0]


def read_formula(text: str, known: tuple[str, ...]) -> Formula:
    """Read a formula.

    known: permitted names

    Raises BadInputError for an unknown name, an unsupported operation, a text longer than
    `_LONGEST` characters, and for anything that is not a formula.
    """
    if len(text) > _LONGEST:
        raise BadInputError(
            f"{shown(text)} is too long for a formula; give at most {_LONGEST} characters"
        )
    names = [name for name in dict.fromkeys(re.findall(_NAME, text)) if name not in RESERVED]
    for name in names:
        refuse_unknown(f"the formula {shown(text)} contains the unknown name", name, (*known, "pi"))
    symbols = {name: ca.SX.sym(name) for name in names if name != "pi"}
    try:
        (value,) = expressions(text.strip(), symbols | {"pi": ca.SX(math.pi)}, "")
        function = ca.Function("formula", [*symbols.values()], [value])
    except Exception as error:  # each raises other exceptions: parser, floats, CasADi
        raise BadInputError(
            f"{shown(text)} is not a formula; use only numbers, names, + - * / ** and "
            f"{', '.join(RESERVED)}"
        ) from error
    return Formula(tuple(symbols), function)
