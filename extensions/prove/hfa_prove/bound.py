"""Lower bounds of the cost of flights, read from certificates."""

from __future__ import annotations

from pathlib import Path

from hfa_flight.problem import FlightProblem
from hfa_prove.certificate import read_certificate
from hfa_prove.check import check
from hfa_prove.problem import given_of
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.plant import Subject
from hfa_prove.subject import Given, compare
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress


def lower_bound(
    path: Path, problem: FlightProblem, progress: Progress | None = None
) -> CostStatement:
    """Return the lower bound of the cost that a certificate proves for the flights of a problem.

    Raises BadInputError if an input of the problem is constant, derivatives depend on a state that
    the cost omits, or the certificate is about other flights. Raises BadInputError or
    NoSolutionError if the certificate does not prove its statement.
    """
    if problem.inputs != tuple(problem.model.inputs):
        raise BadInputError(
            f"the bound in {path} applies to flights in which all inputs move; "
            "remove the argument inputs"
        )
    given = given_of(problem, "this command")
    for name in ("Q", "R"):
        given[name] = Given(getattr(problem, name), f"--{name}")
    certificate = read_certificate(path, Subject(problem.model))
    try:
        compare(certificate.statement, given)
    except NoSolutionError as error:
        raise BadInputError(f"{path}: {error}") from error
    check(certificate, progress)
    return certificate.statement
