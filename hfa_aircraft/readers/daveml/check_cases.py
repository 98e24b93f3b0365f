"""Recomputation of the check cases of a DAVE-ML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca

from hfa_aircraft.readers.daveml.document import CheckCase, Document, Signal, Variable
from hfa_aircraft.readers.daveml.functions import Expressions
from hfa_aircraft.readers.daveml.names import spelled
from hfa_aircraft.rigid.tables import Interpolator
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Result
from hfa_support.reporting.text import Table


@dataclass(frozen=True)
class CheckedOutput(Result):
    """One output of a check case, with its printed and its computed value.

    case: name of the check case.
    output: name of the output.
    printed: value printed in the file.
    computed: value computed from the tables and formulas of the file.
    tolerance: largest permitted difference, from the file.
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

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {"ok": self.ok}


@dataclass(frozen=True, eq=False, repr=False)
class CheckedDocument(Result, Reported):
    """A DAVE-ML file with its recomputed check cases.

    document: the file.
    outputs: outputs of all check cases.
    """

    schema = "hfa.daveml-check/1"

    document: Document
    outputs: Sequence[CheckedOutput]

    @property
    def path(self) -> str:
        """Path of the file."""
        return self.document.path

    @property
    def title(self) -> str:
        """Title in the header of the file."""
        return self.document.title

    @property
    def cases(self) -> int:
        """Number of check cases."""
        return len(self.document.cases)

    @property
    def ok(self) -> bool:
        """True if there are outputs and all agree within their tolerances."""
        return bool(self.outputs) and all(output.ok for output in self.outputs)

    @property
    def unchecked(self) -> list[str]:
        """Names of the outputs of the file that no check case contains."""
        compared = {output.output for output in self.outputs}
        return [
            each.name
            for each in self.document.variables.values()
            if each.is_output and each.name not in compared
        ]

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "outputs": self.outputs,
            "path": self.path,
            "title": self.title,
            "cases": self.cases,
            "ok": self.ok,
        }

    def report(self) -> Report:
        """Return the report with the outputs that differ and the inputs and outputs of the file."""
        agreeing = sum(output.ok for output in self.outputs)
        verdict = "PASS" if self.ok else "FAIL"
        first = f"{verdict}: {agreeing} of {len(self.outputs)} outputs of {self.cases} check cases"
        if not self.outputs:
            first = "FAIL: the file has no check case; nothing is verified"
        wrong = [
            (
                output.case,
                output.output,
                f"{output.printed:.10g}",
                f"{output.computed:.10g}",
                f"{output.tolerance:.3g}",
            )
            for output in self.outputs
            if not output.ok
        ]
        parts: list[Table | str] = [f"{self.title}, {self.path}".lstrip(", ")]
        if wrong:
            header = ("check case", "output", "printed", "computed", "tolerance")
            parts.append(Table(header, wrong))
        rows = [
            (each.name, each.key, each.units, "input" if each.is_input else "output")
            for each in self.document.variables.values()
            if each.is_input or each.is_output
        ]
        parts.append(Table(("variable", "varID", "unit", ""), rows))
        if self.outputs:
            parts.append("Internal values of the cases are not compared.")
            if self.unchecked:
                parts.append(f"Outputs without a check case: {', '.join(self.unchecked)}.")
        return Report(first, parts, data=self.as_data())


def checked_document(document: Document) -> CheckedDocument:
    """Recompute the check cases of a file from the tables and formulas in the file.

    Raises BadInputError if a case names an unknown variable, uses another unit than the variable,
    or contains an output that cannot be computed from the inputs.
    """
    return CheckedDocument(
        document, [each for case in document.cases for each in _checked(document, case)]
    )


def _checked(document: Document, case: CheckCase) -> list[CheckedOutput]:
    given = {_variable(document, case, signal).key: ca.SX(signal.value) for signal in case.inputs}
    expressions = Expressions(document, given, Interpolator())
    outputs = []
    for signal in case.outputs:
        variable = _variable(document, case, signal)
        computed = float(ca.evalf(ca.SX(expressions[variable.key])))
        outputs.append(
            CheckedOutput(case.name, variable.name, signal.value, computed, signal.tolerance)
        )
    return outputs


def _variable(document: Document, case: CheckCase, signal: Signal) -> Variable:
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
