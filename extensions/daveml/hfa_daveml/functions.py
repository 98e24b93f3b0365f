"""Variables of a DAVE-ML file as CasADi expressions of the inputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.rigid.tables import Interpolator
from hfa_daveml.document import Document, Variable
from hfa_daveml.mathml import expression
from hfa_support.errors import BadInputError


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
            key: _between(value, document.variables[key].least, document.variables[key].most)
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
            self._values[key] = _between(self._value(variable), variable.least, variable.most)
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
            arguments = [_between(self[axis.key], axis.least, axis.most) for axis in function.axes]
            return function.table.value(arguments, self._table)
        if variable.formula is not None:
            try:
                return expression(variable.formula, self.__getitem__)
            except BadInputError as error:
                if str(error).startswith(self._document.path):
                    raise
                raise self._document.error(f"variable {variable.key}", str(error)) from error
        if variable.initial is None:
            raise self._document.error(
                f"variable {variable.key}",
                "the variable has no table, formula or initial value; add the attribute "
                "initialValue",
            )
        return variable.initial


def _between(value: Any, least: float, most: float) -> Any:
    """Return a value, clipped to limits that may be infinite."""
    if np.isfinite(least):
        value = ca.fmax(value, least)
    if np.isfinite(most):
        value = ca.fmin(value, most)
    return value
