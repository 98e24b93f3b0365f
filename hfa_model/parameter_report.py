"""What a set of parameters says."""

from __future__ import annotations

from hfa_model.parameters import FIELDS, Parameters, ParameterSet
from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table


def parameter_report(parameters: ParameterSet) -> Report:
    """Every parameter with its standard error, unit and source."""
    return Report("Parameters of the aircraft", (parameters_table(parameters),))


def parameters_table(parameters: ParameterSet) -> Table:
    """One row a parameter."""
    errors = parameters.standard_errors
    rows = [
        (
            name,
            f"{getattr(parameters.values, name):.7g}",
            f"{errors[name]:.2g}" if name in errors else "-",
            getattr(FIELDS, name).unit,
            parameters.sources[name],
        )
        for name in Parameters._fields
    ]
    return Table(("parameter", "value", "standard error", "unit", "source"), rows)
