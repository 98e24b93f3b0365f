"""Reports of proved values of nonlinear games: text, tables and data."""

from __future__ import annotations

from collections.abc import Sequence

from hfa_prove.check import Proved
from hfa_prove.report import weights_lines
from hfa_prove.results import CheckedValue, FoundValue
from hfa_prove.statements.value import ValueStatement
from hfa_prove.subject import qualified
from hfa_prove.words import parameters_in_words
from hfa_support.reporting.report import Report

_NOT_COVERED = (
    "Not covered: the set in which V is the value, terms beyond this degree, limits of the inputs."
)


def found_value_report(statement: ValueStatement, rays: int) -> Report:
    """Return the report of a proved value."""
    data = FoundValue(statement, rays).as_data()
    return Report(f"Proved: {_claim(statement)}", _parts(statement, rays), data=data)


def checked_value_report(verified: Proved, not_given: Sequence[str]) -> Report:
    """Return the report of a checked certificate of a value.

    not_given: parts of the statement that were not compared, because the user did not give them
    """
    statement = verified.statement
    title = qualified(f"Verified, proved: {_claim(statement)}", not_given)
    origin = "written by hfa {version} on {date}: {command}".format(**verified.written)
    parts = (*_parts(statement, verified.size), _subject(statement), origin)
    data = CheckedValue(statement, verified.size, verified.written, list(not_given)).as_data()
    return Report(title, parts, data=data)


def _claim(statement: ValueStatement) -> str:
    return f"value of the nonlinear game to degree {statement.order}, {statement.plant.model.title}"


def _parts(statement: ValueStatement, rays: int) -> tuple[str, ...]:
    """Return sentences on the claim, and on what it does not cover."""
    return (
        f"Each coefficient of the Hamilton-Jacobi-Isaacs equation up to degree {statement.order} is"
        " 0,\nand that of its derivative with respect to u, within"
        f" {statement.residual:.2g} of the sum of its terms ({rays} rays).\n"
        "The quadratic part of V is positive definite, and A - S P is Hurwitz.",
        _NOT_COVERED,
    )


def _subject(statement: ValueStatement) -> str:
    """Return the trim, the parameters and the weights as text."""
    plant = statement.plant
    describe = plant.model.describe
    values = {**plant.trim, **plant.inputs, **plant.held}
    trim = ", ".join(f"{name} {describe(name, value)}" for name, value in values.items())
    model = parameters_in_words(plant.model, plant.parameters)
    return "\n".join([f"Trim: {trim}.", model, *weights_lines(statement.weights)])
