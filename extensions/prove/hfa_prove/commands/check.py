"""The command `hfa prove --check`."""

from __future__ import annotations

from pathlib import Path

from hfa.options.output import ProgressLine
from hfa.options.request import command
from hfa_prove.commands.request import CheckRequest
from hfa_support.errors import BadInputError

#: Statements that a command `hfa prove STATEMENT` proves.
STATEMENTS = ("cost", "critic", "region", "schedule", "solution", "value")


@command(CheckRequest)
def prove(request: CheckRequest) -> int:
    """Verify a certificate by proving the statement again in ball arithmetic.

    For your own aircraft, give the file with --aircraft. The other options are compared with the
    statement: the aircraft with parameters, trim and limits, or the plant of --model, and the
    weights, gains or critic. The first line of the report names the parts that were not given.
    Exit code 0: the statement is proved. Exit code 1: the statement is not proved, or differs from
    an option. The command requires the package python-flint."""
    from hfa_prove.certificate import kind_in
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    if request.check is None:
        known = ", ".join(STATEMENTS)
        raise BadInputError(
            f"no statement to prove is given; choose from {known}, or add --check FILE"
        )
    kind = kind_in(request.check)
    if kind == "region":
        from hfa_prove.commands import region

        return region.check(request, request.check)
    if kind == "cost":
        from hfa_prove.commands import cost

        return cost.check(request, request.check)
    if kind == "value":
        from hfa_prove.commands import value

        return value.check(request, request.check)
    return _check(request, request.check)


def _check(request: CheckRequest, certificate: Path) -> int:
    """Verify a certificate of a schedule or a game, and return the exit code.

    The code is 0 if the full claim is proved, and 1 if only a part is proved or the claim is
    refuted.

    Raises BadInputError if an option does not apply. Raises NoSolutionError if the statement is not
    proved or differs from the user's data.
    """
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check
    from hfa_prove.commands.given import given_for
    from hfa_prove.report import checked_report
    from hfa_prove.statements.plant import Subject
    from hfa_prove.subject import compare

    request.refuse(
        ("policy", "reading.network", "set"),
        "applies to the region of a network or deployment file, but the certificate is about "
        "another statement; remove this option",
    )
    own = request.model if request.aircraft.own else None
    read = read_certificate(certificate, Subject(own))
    not_given = compare(read.statement, given_for(read.statement, request))
    report = checked_report(check(read, ProgressLine("check")), not_given)
    request.show(report)
    return 0 if report.data["proved"] else 1
