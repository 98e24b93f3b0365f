"""Check cases of a DAVE-ML file, recomputed from its tables and formulas."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import casadi as ca

from hfa_aircraft.rigid.tables import Interpolator
from hfa_daveml.document import CheckCase, Document, Signal, Variable
from hfa_daveml.functions import Expressions
from hfa_daveml.names import spelled
from hfa_support.errors import BadInputError


class CheckedOutput(NamedTuple):
    """One output of a check case, with its printed and its computed value.

    case: name of the check case
    output: name of the output
    printed: value printed in the file
    computed: value computed from the tables and formulas of the file
    tolerance: largest permitted difference, from the file
    """

    case: str
    output: str
    printed: float
    computed: float
    tolerance: float

    @property
    def ok(self) -> bool:
        """True if the printed and computed values differ by at most the tolerance."""
        return abs(self.computed - self.printed) <= self.tolerance


def value_of(document: Document, output: str, inputs: Mapping[str, float | ca.SX]) -> ca.SX:
    """Return a variable of a file at numbers or expressions for others, all by varID.

    Raises BadInputError if the variable cannot be computed from these.
    """
    given = {key: ca.SX(value) for key, value in inputs.items()}
    return ca.SX(Expressions(document, given, Interpolator())[output])


def checked_outputs(document: Document) -> list[CheckedOutput]:
    """Return the outputs of all check cases of a file with their computed values.

    Raises BadInputError if a case names an unknown variable, uses another unit than the variable,
    or contains an output that cannot be computed from the inputs.
    """
    return [output for case in document.cases for output in _checked(document, case)]


def refuse_wrong(document: Document) -> None:
    """Raise BadInputError if an output of a check case is not that of the tables and formulas."""
    wrong = [output for output in checked_outputs(document) if not output.ok]
    if wrong:
        case, output, printed, computed, tolerance = wrong[0]
        raise BadInputError(
            f"{document.path}: {len(wrong)} outputs of the check cases differ from the tables and "
            f"formulas, as {output} of {case}: {printed:.10g} in the check case, computed "
            f"{computed:.10g}, tolerance {tolerance:.3g}; correct the file"
        )


def _checked(document: Document, case: CheckCase) -> list[CheckedOutput]:
    """Return the outputs of one check case."""
    inputs = {_variable(document, case, each).key: each.value for each in case.inputs}
    outputs = []
    for signal in case.outputs:
        variable = _variable(document, case, signal)
        computed = float(ca.evalf(value_of(document, variable.key, inputs)))
        outputs.append(
            CheckedOutput(case.name, variable.name, signal.value, computed, signal.tolerance)
        )
    return outputs


def _variable(document: Document, case: CheckCase, signal: Signal) -> Variable:
    """Return the variable of a signal. Raises BadInputError for an unknown one or another unit."""
    place = f"check case {case.name}"
    variable = document.by_name(signal.name)
    if variable is None:
        raise document.error(
            place,
            f"signal {signal.name} is not a variable of the file; correct the name of the signal",
        )
    units = [spelled(each.units) for each in (signal, variable) if each.units]
    if len(set(units)) > 1:
        raise document.error(
            place,
            f"{signal.name} is in {signal.units} in the check case but in {variable.units} in "
            "the definition; give the same unit in both",
        )
    return variable
