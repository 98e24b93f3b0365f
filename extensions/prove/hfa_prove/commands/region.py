"""The command `hfa prove region`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hfa.options.output import ProgressLine
from hfa.options.request import command
from hfa_prove.commands.options import refuse_no_certificate
from hfa_prove.commands.request import CheckRequest, RegionRequest
from hfa_support.errors import BadInputError
from hfa_support.files import forget_read
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hfa_prove.search.region_search import Region, RegionProblem
    from hfa_prove.statements.loop import Loop

#: Options that have no effect on the check of a certificate.
_OF_THE_SEARCH = ("degree", "seconds", "resume", "output.picture", "prover")
#: Default degree of V for a network or deployment file.
_DEGREE_OF_FUNCTIONS = 2


@command(RegionRequest)
def region(request: RegionRequest) -> int:
    """Prove a region of attraction of the nonlinear loop with saturated inputs.

    Every trajectory that begins in {V(z) <= rho} stays there and within all limits of the model,
    and converges to the trim. z is the deviation from the trim. The policy is u = sat(u0 - K z)
    with K of the exact game, or the gain, polynomial or network in the file of --weights. With
    --disturbance NAME=SIZE, the set is proved invariant under every disturbance up to SIZE, and
    convergence is not claimed. The report also names a state with V' >= 0, an initial condition
    that does not converge, and the active limits. -o FILE.json writes a certificate, and --check
    FILE verifies a certificate. To verify the region of a network or of a deployment file, give
    --weights or --policy again.
    Not covered: sampling, actuators, delays, and a linearization that is not Hurwitz. Exit code 0:
    the set is proved. The command requires the package python-flint."""
    from verification.enclosure.precision import flint_or_refusal

    flint_or_refusal()
    request.refuse(
        ("game.plant",),
        "is a linear plant, but a region requires nonlinear equations; give --aircraft instead",
    )
    if request.check is not None:
        return check(request, request.check)
    refuse_no_certificate(request.output.file, resume=request.resume)
    return _prove(request)


def check(request: CheckRequest | RegionRequest, certificate: Path) -> int:
    """Verify a certificate of a region and return exit code 0.

    certificate: path of the certificate

    Raises BadInputError if an option does not apply to the check. Raises NoSolutionError if the
    statement is not proved or differs from the user's data.
    """
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check as proved_by
    from hfa_prove.commands.given import at_one_value
    from hfa_prove.commands.given_region import given_by, given_for
    from hfa_prove.commands.policies import given_policy, is_function
    from hfa_prove.report_region import checked_report
    from hfa_prove.statements.loop import Gain
    from hfa_prove.statements.plant import Subject
    from hfa_prove.subject import compare

    request.refuse(_OF_THE_SEARCH, "has no effect with --check; remove this option")
    request.refuse(
        ("game.plant",),
        "is a linear plant, but the certificate is about an aircraft; give --aircraft instead",
    )
    request.refuse(
        ("design",),
        "applies to a schedule, but the certificate is about a region; remove this option",
    )
    own = given_policy(at_one_value(request)) if is_function(request) else None
    model = request.model if request.aircraft.own else None
    subject = Subject(model, None if own is None else own.problem.loop.function)
    read = read_certificate(certificate, subject)
    if own is not None and not isinstance(read.statement.loop.policy, Gain):
        given = given_by(own.problem.loop, "the user")
    else:
        request.refuse(
            ("policy", "reading.network", "set"),
            "applies to a policy in a file, but the certificate is about a polynomial policy; "
            "remove this option",
        )
        given = given_for(read.statement, request)
    not_given = compare(read.statement, given)
    words = {} if own is None else {"policy": own.words, "timing": own.timing}
    proved = proved_by(read, ProgressLine("check"))
    request.show(checked_report(proved, not_given, **words))
    return 0


def _prove(request: RegionRequest) -> int:
    from hfa_prove.certificate import write_certificate
    from hfa_prove.commands.policies import given_policy, is_function
    from hfa_prove.report_region import region_report
    from hfa_prove.search.region import proved_region
    from hfa_support.interruption import interruptible

    if is_function(request):
        request.refuse(
            ("disturbance",), "cannot be combined with a network or --policy; remove this option"
        )
    given = given_policy(request)
    problem = given.problem
    problem = replace(problem, loop=replace(problem.loop, disturbances=request.disturbance))
    degree = request.degree
    if given.gain is None and "degree" not in request.typed:
        degree = _DEGREE_OF_FUNCTIONS
    provers = _provers(request, problem)
    origin = request.provenance.to_dict()

    def save(proved: Region) -> None:
        if request.output.file is not None:
            write_certificate(request.output.file, proved.statement, proved.witness, origin)

    with interruptible(ProgressLine("region")) as progress:
        found = proved_region(
            problem,
            provers,
            degree=degree,
            seconds=request.seconds,
            progress=progress,
            save=save,
            earlier=_earlier(request, problem),
        )

    def figure() -> Figure:
        from hfa_prove.picture import region_figure

        return region_figure(found, _box(given.linear))

    report = region_report(found, given.words, given.timing)
    request.show(report, figure=figure, write=lambda _: save(found))
    return 0


def _provers(request: RegionRequest, problem: RegionProblem) -> tuple[str, ...]:
    """Return the provers to try: that of --prover, or all that apply.

    Raises BadInputError if the given prover does not apply.
    """
    from hfa_prove.search.region import provers_of

    applicable = provers_of(problem)
    if request.prover is None:
        return applicable
    if request.prover not in applicable:
        what = "a disturbance" if problem.loop.disturbances else "a network or deployment file"
        raise BadInputError(
            f"--prover {request.prover} does not support {what}; use --prover {applicable[0]}"
        )
    return (request.prover,)


def _box(linear: LinearModel) -> np.ndarray | None:
    """Return the half-widths (n,) of the box in which `hfa verify` compares critics, or None.

    The result is None if the model is not the paper's and a state has no limits, or its trim is at
    or beyond a limit.

    linear: linear model at the trim
    """
    from controller.game.linear_game import widths_within_limits
    from verification.box import ordinary_box

    units = linear.point.model.units(linear.states)
    box = ordinary_box(linear.states, linear.inputs, units)
    return widths_within_limits(linear) if box is None else box.half_widths


def _earlier(request: RegionRequest, problem: RegionProblem) -> Region | None:
    """Return the region of an earlier run's certificate, or None without --resume.

    Raises BadInputError if the certificate concerns another loop or the prover is another one.
    """
    from hfa_prove.certificate import read_sealed
    from hfa_prove.check import check_certificate
    from hfa_prove.search.region import region_of_certificate

    if not request.resume:
        return None
    path = request.output.file
    assert path is not None
    policy = problem.loop.function
    own = request.model if request.aircraft.own else None
    proved = check_certificate(path, ProgressLine("check"), own, policy)
    witness = read_sealed(path)[0]["witness"]
    forget_read(path)
    if not _same_loop(proved.statement.loop, problem.loop):
        raise BadInputError(f"{path} is the certificate of another loop; give another path with -o")
    earlier = region_of_certificate(proved, witness)
    if request.prover not in (None, earlier.prover):
        raise BadInputError(
            f"{path} is proved by {earlier.prover}; remove --prover, or give another path with -o"
        )
    return earlier


def _same_loop(first: Loop, second: Loop) -> bool:
    """Return whether two loops have the same parameters, trim, inputs and policy."""
    one, other = first.content(), second.content()
    return all(one[name] == other[name] for name in ("parameters", "trim", "inputs", "policy"))
