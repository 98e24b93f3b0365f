"""The command `hfa prove --check`."""

from __future__ import annotations

from hfa.options.command import Outcome, command
from hfa.options.output import ProgressLine
from hfa.options.plants import aircraft_source
from hfa_prove.commands.request import CheckRequest
from hfa_support.errors import BadInputError

#: Statements that a command `hfa prove STATEMENT` proves.
STATEMENTS = ("region", "schedule")


@command(CheckRequest)
def prove(request: CheckRequest) -> Outcome:
    """Verify a certificate by proving the statement again.

    The subject is given as in the proof: the aircraft with its file, parameters, trim and limits,
    and the weights, gains, policy or disturbances. Every option is compared with the statement. The
    first line of the report names the parts that were not given. Exit code 0: the statement is
    proved. Exit code 1: the statement is not proved, or differs from an option. The command
    requires the package python-flint."""
    from hfa_prove.certificate import kind_in, read_certificate
    from hfa_prove.check import check
    from hfa_prove.commands.given import checked_trim, given_for, refuse_unfit
    from hfa_prove.commands.policies import given_policy, is_function
    from hfa_prove.enclosure.precision import flint_or_refusal
    from hfa_prove.report import checked_report
    from hfa_prove.statements.plant import Subject
    from hfa_prove.subject import compare

    flint_or_refusal()
    path = request.check
    if path is None:
        known = ", ".join(STATEMENTS)
        raise BadInputError(
            f"no statement to prove is given; choose from {known}, or add --check FILE"
        )
    kind = kind_in(path)
    refuse_unfit(request, kind)
    trim = checked_trim(request, kind)
    own = None
    if kind == "region" and is_function(request):
        own = given_policy(request, trim.given)
    model = trim.given.common.model if request.aircraft is not None else None
    policy = None if own is None else own.problem(trim.given.common.limits).loop.function
    certificate = read_certificate(path, Subject(model, policy))
    statement = certificate.statement
    not_given = compare(statement, given_for(statement, request, trim, own))
    proved = check(certificate, ProgressLine("check"))
    source = {} if model is None else aircraft_source(request, model)
    report = checked_report(proved, not_given, "" if own is None else own.words)
    return Outcome(report=report, source=source)
