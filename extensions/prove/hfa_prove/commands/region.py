"""The command `hfa prove region`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from controller.critic.critic_file import is_network
from hfa.inherited import print_report, show
from hfa.options.output import ProgressLine
from hfa.options.request import command
from hfa_prove.commands.request import CheckRequest, RegionRequest
from hfa_support.errors import BadInputError
from hfa_support.files import forget_read
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from hfa_prove.search.monomials import PolynomialFunction
    from hfa_prove.statements.loop import Loop

#: Options that have no effect on the check of a certificate.
_OF_THE_SEARCH = ("degree", "seconds", "resume", "picture", "prover")


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
        ("plant",),
        "is a linear plant, but a region requires nonlinear equations; give --aircraft instead",
    )
    if request.check is not None:
        return check(request, request.check)
    if request.output is not None and request.output.suffix.lower() != ".json":
        raise BadInputError(
            f"{request.output}: a certificate must be a .json file; give a path "
            "with the suffix .json"
        )
    if request.resume and request.output is None:
        raise BadInputError(
            "--resume requires an unfinished certificate; give the path with -o FILE.json"
        )
    if request.policy is None and not _is_network(request):
        return _prove(request)
    from hfa_prove.commands.region_boxes import prove_on_boxes

    return prove_on_boxes(request)


def check(request: CheckRequest | RegionRequest, certificate: Path) -> int:
    """Verify a certificate of a region and return exit code 0.

    certificate: path of the certificate

    Raises BadInputError if an option does not apply to the check. Raises NoSolutionError if the
    statement is not proved or differs from the user's data.
    """
    from hfa_prove import report_boxes, report_squares
    from hfa_prove.certificate import read_certificate
    from hfa_prove.check import check as proved_by
    from hfa_prove.commands.given import at_one_value
    from hfa_prove.commands.given_region import given_by, given_for
    from hfa_prove.statements.loop import Gain
    from hfa_prove.statements.plant import Subject
    from hfa_prove.statements.region import BoxWitness
    from hfa_prove.subject import compare

    request.refuse(_OF_THE_SEARCH, "has no effect with --check; remove this option")
    request.refuse(
        ("plant",),
        "is a linear plant, but the certificate is about an aircraft; give --aircraft instead",
    )
    request.refuse(
        ("design",),
        "applies to a schedule, but the certificate is about a region; remove this option",
    )
    model = request.model if request.own else None
    own = None
    if request.policy is not None or _is_network(request):
        from hfa_prove.commands.region_boxes import loop_of, policy_of, scalars

        linear, own, _ = policy_of(at_one_value(request))
        subject = Subject(model, scalars(own.function))
    else:
        subject = Subject(model)
    read = read_certificate(certificate, subject)
    statement = read.statement
    if own is not None and not isinstance(statement.loop.policy, Gain):
        given = given_by(loop_of(linear, own), "the user")
    else:
        request.refuse(
            ("policy", "network", "set"),
            "applies to a policy in a file, but the certificate is about a polynomial policy; "
            "remove this option",
        )
        given = given_for(statement, request)
    not_given = compare(statement, given)
    proved = proved_by(read, ProgressLine("check"))
    if not isinstance(read.witness, BoxWitness):
        show(report_squares.checked_report(proved, not_given), request)
    elif own is None:
        show(report_boxes.checked_report(proved, "the gain K", not_given=not_given), request)
    else:
        show(report_boxes.checked_report(proved, own.words, own.not_covered, not_given), request)
    return 0


def _is_network(request: CheckRequest | RegionRequest) -> bool:
    return request.weights is not None and is_network(request.weights)


def _prove(request: RegionRequest) -> int:
    from hfa_prove.certificate import write_certificate
    from hfa_prove.check.loop_squares import refuse_curved
    from hfa_prove.commands.given_region import loop_of
    from hfa_prove.commands.region_boxes import better_on_boxes, prove_gain_on_boxes
    from hfa_prove.report_squares import region_report
    from hfa_prove.search.invariant import invariant_region
    from hfa_prove.search.level import ProvedLevel
    from hfa_prove.search.plant import saturated_loop
    from hfa_prove.search.region_squares import RegionSearch
    from hfa_prove.statements.loop import Gain
    from hfa_support.interruption import interruptible

    linear, K, P, policy = loop_of(request)
    loop = saturated_loop(linear, K, policy)
    refuse_curved(replace(loop, disturbances=request.disturbance))
    reason = "" if request.prover else better_on_boxes(request, loop)
    if reason or request.prover == "boxes":
        return prove_gain_on_boxes(request, linear, Gain(K, policy), P, reason)
    known = _known(request, loop)
    origin = request.provenance.to_dict()

    def save(proved: ProvedLevel) -> None:
        if request.output is not None:
            write_certificate(request.output, proved.statement, proved.witness, origin)

    with interruptible(ProgressLine("region")) as progress:
        search = RegionSearch(
            loop,
            P,
            seconds=request.seconds,
            degree=request.degree,
            progress=progress,
            save=None if request.disturbance else save,
        )
        found = search.found(known)
        if request.disturbance:
            found = invariant_region(found, request.disturbance, progress)
            save(found.proved)
    if request.picture is not None:
        from hfa_prove.picture import region_figure
        from hfa_support.reporting.figure import save as save_figure

        figure = region_figure(found, _box(linear))
        save_figure(figure, request.picture, request.provenance.text())
    print_report(region_report(found), request)
    return 0


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


def _known(request: RegionRequest, loop: Loop) -> PolynomialFunction | None:
    """Return V of an earlier run's certificate, scaled to level 1, or None without --resume.

    loop: the loop of this run

    Raises BadInputError if the certificate concerns another loop.
    """
    if not request.resume:
        return None
    from hfa_prove.check import check_certificate
    from hfa_prove.commands.region_boxes import same_loop
    from hfa_prove.search.monomials import PolynomialFunction

    path = request.output
    assert path is not None
    own = request.model if request.own else None
    statement = check_certificate(path, model=own).statement
    forget_read(path)
    if not (statement.piece.whole and same_loop(statement.loop, loop)):
        raise BadInputError(f"{path} is the certificate of another loop; give another path with -o")
    return PolynomialFunction.of_terms(statement.terms).scaled(1.0 / statement.rho)
