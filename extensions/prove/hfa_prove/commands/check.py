"""The command `hfa prove --check`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hfa.options.argument_types import input_file
from hfa.options.command import Outcome, Request, command
from hfa.options.games import WeightOptions
from hfa.options.option import option
from hfa.options.output import ProgressLine
from hfa.options.plants import aircraft_source
from hfa.options.trims import TrimOptions, at_option, dihedral_option
from hfa_support.errors import BadInputError
from hfa_support.files import MATRIX_FILES


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRequest(Request, TrimOptions, WeightOptions):
    """Options of `hfa prove --check`: a certificate, and data with which it must agree."""

    units: None = None
    start: None = None
    conditions: None = None
    row: None = None
    at: str | None = at_option("value or interval that the certificate must contain", "LOW:HIGH")
    dihedral: str | None = dihedral_option(
        "value or interval of the dihedral angle that the certificate must contain", "DEG|LOW:HIGH"
    )
    check: Path | None = option("certificate to verify", "FILE", input_file(".json"))
    weights: Path | None = option(
        "file with the gains that the certificate must be about",
        "FILE",
        input_file(*MATRIX_FILES),
    )


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
    from hfa_prove.report import checked_report
    from hfa_prove.subject import compare

    path = request.check
    if path is None:
        raise BadInputError(
            "no statement to prove is given; use `hfa prove schedule`, or add --check FILE"
        )
    trim = asked_trim(request)
    model = trim.given.common.model if request.aircraft is not None else None
    certificate = read_certificate(path, model)
    not_given = compare(certificate.statement, given_for(certificate.statement, request, trim))
    proved = check(certificate, ProgressLine("check"))
    source = {} if model is None else aircraft_source(request, model)
    return Outcome(report=checked_report(proved, not_given), source=source)
