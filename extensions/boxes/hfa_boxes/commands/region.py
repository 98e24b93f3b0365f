"""`hfa prove region` of a policy that is a function: proved on boxes, or a certificate checked."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from hfa.options.trims import OutputOptions
from hfa.output import ProgressLine, print_report, show
from hfa_boxes.check.checker import check_certificate, write_certificate
from hfa_boxes.check.loop import Loop
from hfa_boxes.check.statement import model_limits
from hfa_boxes.report import checked_report, found_report
from hfa_boxes.search.region import BoxRegion, RegionSearch, Samples, flown
from hfa_support.errors import BadInputError

if TYPE_CHECKING:
    from controller.critic.critic import Critic
    from hfa_aircraft.model import Model
    from trim.linear.linear_model import LinearModel


def loop_of(linear: LinearModel, critic: Critic) -> Loop:
    """The loop of a critic's policy about the trim of a linear model."""
    model = linear.point.model
    states = {name: float(value) for name, value in linear.point.states._asdict().items()}
    parameters = {name: signal.start for name, signal in model.parameters.items()}
    return Loop(
        model,
        parameters,
        {name: states[name] for name in model.linear},
        {name: float(value) for name, value in linear.point.inputs._asdict().items()},
        {name: value for name, value in states.items() if name not in model.linear},
        model_limits(model, states, parameters),
        scalars(critic.policy),
    )


def scalars(policy: ca.Function) -> ca.Function:
    """A policy as a function of scalars, whose instructions are read; BadInputError where its
    operations cannot be."""
    if not policy.is_a("MXFunction"):
        return policy
    try:
        return policy.expand()
    except RuntimeError as error:
        raise BadInputError(
            "its policy is solved for by iteration; give a network of the policy itself"
        ) from error


def prove(
    request: OutputOptions, linear: LinearModel, critic: Critic, P: np.ndarray, seconds: float
) -> int:
    """Prove the largest region found, write its certificate to -o, print it; the exit code.

    P: of the exact game, tried as V with that of the critic
    """
    loop = loop_of(linear, critic)
    known = [("P of the game", P)]
    if critic.P is not None:
        known.append(("P of the critic", critic.P))

    def save(region: BoxRegion) -> None:
        if request.output is not None:
            origin = request.provenance.to_dict()
            write_certificate(request.output, region.statement, region.witness, origin)

    search = RegionSearch(loop, known, seconds=seconds, progress=ProgressLine("region"), save=save)
    region = search.found()
    place = region.rises[1]
    flight = None
    if place is not None:
        flight = flown(Samples(loop, search.equilibrium), search.J, place, region)
    print_report(found_report(region, critic.origin, flight), request)
    return 0


def check(
    request: OutputOptions,
    path: Path,
    linear: LinearModel,
    critic: Critic,
    own: Model | None,
) -> int:
    """Verify a certificate against the user's policy; the exit code."""
    verified = check_certificate(path, scalars(critic.policy), ProgressLine("check"), own)
    _require_same_trim(verified.statement.loop, loop_of(linear, critic), path)
    show(checked_report(verified, critic.origin), request)
    return 0


def _require_same_trim(stated: Loop, of_user: Loop, path: Path) -> None:
    """BadInputError unless parameters, trim, inputs and held states are those of the user."""
    for what in ("parameters", "trim", "inputs", "held"):
        theirs = getattr(stated, what)
        for name, value in getattr(of_user, what).items():
            size = of_user.model.signals[name].nominal if name in of_user.model.signals else 1.0
            if not abs(theirs[name] - value) <= 1e-6 * max(abs(size), abs(value)):
                raise BadInputError(
                    f"{path}: is about {name} {theirs[name]:.9g}, not {value:.9g}; give the trim "
                    "that it was proved at"
                )
