"""The command `hfa prove --check`."""

from __future__ import annotations

from hfa.options.command import Outcome, ProgressLine, command
from hfa.options.plants import loaded_aircraft
from hfa_prove.commands.check_request import CheckRequest
from hfa_support.errors import BadInputError


@command(CheckRequest)
def prove(request: CheckRequest) -> Outcome:
    """Verify a certificate by proving the statement again.

    The subject is given as in the proof: the aircraft with its file, parameters, trim and limits,
    and the gains or the weights of their game. Every option is compared with the statement. The
    first line of the report names the parts that were not given. Exit code 0: the statement is
    proved. Exit code 1: the statement is not proved, or differs from an option."""
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check
    from hfa_prove.commands.given import asked_trim, given_for
    from hfa_prove.fields import compare
    from hfa_prove.report import checked_report

    path = request.check
    if path is None:
        raise BadInputError(
            "no statement to prove is given; use `hfa prove schedule`, or add --check FILE"
        )
    trim = asked_trim(request)
    is_own = request.aircraft is not None or request.servo is not None
    model = trim.given.common.model if is_own else None
    certificate = read_certificate(path, model)
    # If options differ, or the proof fails, these two raise a NoSolutionError (exit code 1).
    not_given = compare(certificate.statement, given_for(certificate.statement, request, trim))
    size = check(certificate, ProgressLine("check"))
    source = {} if model is None else loaded_aircraft(request).source
    return Outcome(report=checked_report(certificate, size, not_given), source=source)
