"""The command `hfa prove --check`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from hfa.options.output import ProgressLine
from hfa.options.request import command
from hfa_prove.commands.request import CheckRequest
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from hfa_prove.check import Proved
    from hfa_prove.commands.policies import GivenPolicy
    from hfa_prove.commands.request import CostRequest, RegionRequest
    from hfa_prove.subject import Given
    from hfa_support.reporting.report import Report

#: Statements that a command `hfa prove STATEMENT` proves.
STATEMENTS = ("cost", "critic", "region", "schedule", "solution", "value")
#: Options of a search.
_OF_THE_SEARCH = ("degree", "margin", "prover", "seconds", "resume", "output.picture")
#: Options of a network or of a deployed policy.
_OF_FUNCTIONS = ("policy", "reading.network", "reading.set")
#: Kind of a certificate -> its subject, and the options that do not apply to this subject.
_SUBJECTS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "schedule": ("a schedule", _OF_FUNCTIONS),
    "game": ("a game", (*_OF_FUNCTIONS, "design")),
    "region": ("a region", ("game.plant", "design")),
    "cost": (
        "a bound of the cost",
        (*_OF_FUNCTIONS, "game.plant", "design", "weights", "reading.basis"),
    ),
    "value": (
        "the value of a nonlinear game",
        (*_OF_FUNCTIONS, "game.plant", "design", "reading.basis"),
    ),
}


class Part(NamedTuple):
    """What belongs to one kind of certificate in its check.

    given: (statement, options) -> (path of an entry -> the value that the options give)
    report: (proved statement, subjects that the user did not give) -> report
    """

    given: Callable[[Any, Any], Mapping[str, Given]]
    report: Callable[[Proved, Sequence[str]], Report]


def _part_of(kind: str, own: GivenPolicy | None) -> Part:
    """Return what belongs to a kind of certificate. Only the modules of this kind are loaded.

    own: the user's policy, if it is a network or a deployed policy
    """
    if kind == "region":
        from hfa_prove.commands.given_region import given_for as given_loop
        from hfa_prove.report_region import checked_report as region_report

        words: dict[str, Any] = {} if own is None else {"policy": own.words, "timing": own.timing}
        return Part(partial(given_loop, own=own), partial(region_report, **words))
    if kind == "cost":
        from hfa_prove.commands.given import given_bound
        from hfa_prove.report_cost import checked_bound_report

        return Part(given_bound, checked_bound_report)
    if kind == "value":
        from hfa_prove.commands.given import given_value
        from hfa_prove.report_value import checked_value_report

        return Part(given_value, checked_value_report)
    from hfa_prove.commands.given import given_for
    from hfa_prove.report import checked_report

    return Part(given_for, checked_report)


@command(CheckRequest)
def prove(request: CheckRequest) -> int:
    """Verify a certificate by proving the statement again in ball arithmetic.

    For your own aircraft, give the file with --aircraft. The other options are compared with the
    statement: the aircraft with parameters, trim and limits, or the plant of --model, and the
    weights, gains or critic. The first line of the report names the parts that were not given.
    Exit code 0: the statement is proved. Exit code 1: the statement is not proved, or differs from
    an option. The command requires the package python-flint."""
    from hfa_prove.certificate import kind_in
    from hfa_prove.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    if request.check is None:
        known = ", ".join(STATEMENTS)
        raise BadInputError(
            f"no statement to prove is given; choose from {known}, or add --check FILE"
        )
    return check(request, request.check, kind_in(request.check))


def check(request: CheckRequest | RegionRequest | CostRequest, path: Path, kind: str) -> int:
    """Verify a certificate, print the report, and return the exit code.

    The code is 0 if the full claim is proved, and 1 if only a part is proved or the claim is
    refuted.

    kind: kind of the certificate

    Raises BadInputError if the certificate is of another kind, or an option does not apply. Raises
    NoSolutionError if the statement is not proved or differs from the user's data.
    """
    from hfa_prove.certificate import kind_in, read_certificate
    from hfa_prove.check import check as proved_by
    from hfa_prove.statements.plant import Subject
    from hfa_prove.subject import compare

    about, without_effect = _SUBJECTS[kind]
    if kind_in(path) != kind:
        raise BadInputError(
            f"{path} is not the certificate of {about}; verify it by hfa prove --check {path}"
        )
    request.refuse(_OF_THE_SEARCH, "has no effect with --check; remove this option")
    request.refuse(
        without_effect, f"does not apply to the certificate of {about}; remove this option"
    )
    own = _own_policy(request) if kind == "region" else None
    model = request.model if request.aircraft.own else None
    policy = None if own is None else own.problem.loop.function
    part = _part_of(kind, own)
    certificate = read_certificate(path, Subject(model, policy))
    not_given = compare(certificate.statement, part.given(certificate.statement, request))
    report = part.report(proved_by(certificate, ProgressLine("check")), not_given)
    request.show(report)
    return 0 if report.data["proved"] else 1


def _own_policy(request: Any) -> GivenPolicy | None:
    """Return the user's policy if it is a network or a deployed policy, otherwise None."""
    from hfa_prove.commands.given import at_one_value
    from hfa_prove.commands.policies import given_policy, is_function

    return given_policy(at_one_value(request)) if is_function(request) else None
