"""Section on a proved region, which `hfa verify --region` adds to the report."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hfa.options.output import ProgressLine
from hfa_support.errors import BadInputError, NoSolutionError, prefix_errors
from hfa_support.reporting.report import Report

if TYPE_CHECKING:
    from hfa.options.game import NamedGame
    from verification.verdict import Verdict

_TITLE = "Region of attraction of the saturated nonlinear loop"
_DEGREE = 4


def with_region(
    report: Report, verdicts: list[Verdict], named: NamedGame, seconds: float
) -> Report:
    """Return the report on a critic with a section on its proved region.

    If no region is proved, the section states the reason. The data of the section is the entry
    `region`.

    report: report without the section
    verdicts: list with the verdict on the critic
    named: the game, of the linear model of an aircraft
    seconds: limit of the processor time of the search, s

    Raises BadInputError for several critics, a policy that is not a polynomial, or a plant without
    nonlinear equations.
    """
    from hfa_prove.commands.policies import GivenPolicy
    from hfa_prove.commands.polynomials import policy_terms
    from hfa_prove.report_region import region_report
    from hfa_prove.results import NothingProved
    from hfa_prove.search.region import proved_region
    from hfa_prove.statements.loop import Gain
    from hfa_support.interruption import interruptible
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    if named.linear is None:
        raise BadInputError(
            "--region requires the nonlinear equations of an aircraft; give --aircraft instead of "
            "--model, or remove --region"
        )
    if len(verdicts) != 1:
        raise BadInputError(
            f"--region supports only one critic, but {len(verdicts)} are given; "
            "give one critic, or remove --region"
        )
    critic = verdicts[0].critic
    with prefix_errors("--region"):
        gain = Gain(critic.K, policy_terms(critic, named.linear.inputs))
    policy = GivenPolicy.of_gain(named.linear, gain, "the critic", critic.P)
    try:
        with interruptible(ProgressLine("region")) as progress:
            found = proved_region(
                policy.problem, degree=_DEGREE, seconds=seconds, progress=progress
            )
        section = region_report(found)
    except NoSolutionError as error:
        section = Report(
            f"{_TITLE}: nothing proved", (f"Because {error}.",), data=NothingProved().as_data()
        )
    parts = (*report.parts, section)
    return replace(report, parts=parts).with_data(region=section.data)
