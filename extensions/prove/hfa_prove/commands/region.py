"""The command `hfa prove region`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hfa.options.command import Outcome, command
from hfa.options.output import ProgressLine
from hfa.options.show import provenance
from hfa.options.trims import scheduled_trim
from hfa_prove.commands.options import refuse_no_certificate
from hfa_prove.commands.request import RegionRequest, disturbances_of

if TYPE_CHECKING:
    from hfa_prove.search.region_search import Region

#: Default degree of V for a polynomial policy, and for a network or deployment file.
_DEGREE = 4
_DEGREE_OF_FUNCTIONS = 2


@command(RegionRequest)
def region(request: RegionRequest) -> Outcome:
    """Prove a region of attraction of the nonlinear loop with saturated inputs.

    Every trajectory that begins in the set {V(z) <= rho, |M z| < 1} stays there and within all
    limits, and converges to the trim. z is the deviation from the trim. The policy is
    u = sat(u0 - K z) with K of the exact game, or the gain, polynomial or network in the file of
    --weights. With --disturbance NAME=SIZE, the set is proved invariant under every disturbance up
    to SIZE, and convergence is not claimed. -o FILE.json writes a certificate for
    `hfa prove --check FILE`.
    Not covered: sampling, actuators, delays, and a linearization that is not Hurwitz. Exit code 0:
    the set is proved. The command requires the package python-flint."""
    from hfa_prove.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    refuse_no_certificate(request.output)
    from hfa_prove.certificate import write_certificate
    from hfa_prove.commands.policies import given_policy
    from hfa_prove.search.region import proved_region
    from hfa_support.interruption import interruptible

    given = scheduled_trim(request)
    disturbances = disturbances_of(request, given.model)
    policy = given_policy(request, given)
    problem = policy.problem(given.common.limits)
    problem = replace(problem, loop=replace(problem.loop, disturbances=disturbances))
    usual = _DEGREE_OF_FUNCTIONS if policy.gain is None else _DEGREE
    origin = provenance(request, given.source).to_dict()

    def save(proved: Region) -> None:
        if request.output is not None:
            write_certificate(request.output, proved.statement, proved.witness, origin)

    with interruptible(ProgressLine("region")) as progress:
        found = proved_region(
            problem,
            degree=request.degree or usual,
            seconds=request.seconds,
            progress=progress,
            save=save,
        )

    report = found.report(policy.words)
    return Outcome(report=report, source=given.source, write=lambda _: save(found))
