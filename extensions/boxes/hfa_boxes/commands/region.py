"""`hfa prove region` on boxes: proof of a region for any policy, and check of a certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from hfa.options.output import ProgressLine, print_report, show
from hfa.options.trims import OutputOptions
from hfa_boxes.check.checker import check_certificate, write_certificate
from hfa_boxes.check.loop import Loop
from hfa_boxes.check.plant import facts, model_limits, pair_of
from hfa_boxes.check.statement import BoxStatement, Gain, digest_of
from hfa_boxes.fields import FIELDS
from hfa_boxes.interruption import interruptible
from hfa_boxes.report import NOT_COVERED, checked_report, found_report
from hfa_boxes.search.region import BoxRegion, RegionSearch, flight_outcome
from hfa_proof.subject import Given, compare, within
from hfa_support.errors import BadInputError
from hfa_support.files import forget_read

if TYPE_CHECKING:
    from hfa_aircraft.model import Model
    from trim.linear.linear_model import LinearModel


@dataclass(frozen=True, eq=False)
class ProvedPolicy:
    """A policy for which a region is to be proved.

    function: the policy, as in `Loop.policy`
    words: description of the policy
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    not_covered: effects that the proof neglects, for the title
    gain: coefficients of the policy if it is a polynomial, otherwise None
    """

    function: ca.Function
    words: str
    known: Sequence[tuple[str, np.ndarray]] = ()
    not_covered: str = NOT_COVERED
    gain: Gain | None = None

    @classmethod
    def of_gain(
        cls, gain: Gain, inputs: tuple[str, ...], words: str, P: np.ndarray | None
    ) -> ProvedPolicy:
        """Return the policy with the given coefficients.

        inputs: names of the inputs, in order
        words: description of the policy
        P: matrix of the value function of the game or critic, (n, n), as a candidate for V, or None
        """
        known = [] if P is None else [("P of the game", P)]
        return cls(gain.function(inputs), words, known, gain=gain)


def loop_of(linear: LinearModel, policy: ProvedPolicy) -> Loop:
    """Return the closed loop of a policy about the trim of a linear model.

    The limits of the loop are those of the model at the trim (`model_limits`).
    """
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
        scalars(policy.function),
    )


def scalars(policy: ca.Function) -> ca.Function:
    """Return an equal policy that is a CasADi function of scalar operations.

    Raises BadInputError if the policy is computed iteratively.
    """
    if not policy.is_a("MXFunction"):
        return policy
    try:
        return policy.expand()
    except RuntimeError as error:
        raise BadInputError(
            "the policy is computed iteratively from a network, which is not supported; give a "
            "network whose output is the policy"
        ) from error


@dataclass(frozen=True)
class SearchSettings:
    """Settings of a search for a region.

    seconds: limit of the processor time, s
    degree: highest degree of V
    resume: whether to continue an earlier run from the certificate in the output file
    reason: reason why the proof uses boxes instead of sums of squares, for the report, or "" if the
        user chose boxes
    """

    seconds: float
    degree: int
    resume: bool = False
    reason: str = ""


def prove(
    request: OutputOptions, linear: LinearModel, policy: ProvedPolicy, settings: SearchSettings
) -> int:
    """Prove a region of attraction as large as possible, print a report and return exit code 0.

    The certificate of each larger region is written to the output file of the request, if there is
    one.

    linear: linear model at the trim of the loop

    Raises NoSolutionError if no region is proved.
    """
    loop = loop_of(linear, policy)
    stated = policy.gain or digest_of(loop.policy)

    def save(region: BoxRegion) -> None:
        if request.output is not None:
            origin = request.provenance.to_dict()
            write_certificate(request.output, region.statement, region.witness, origin)

    earlier = None
    if settings.resume:
        assert request.output is not None
        earlier = _earlier(request.output, loop, stated)
    with interruptible(ProgressLine("region")) as progress:
        search = RegionSearch(
            loop,
            stated,
            policy.known,
            seconds=settings.seconds,
            degree=settings.degree,
            progress=progress,
            save=save,
        )
        region = search.found(earlier)
    place = region.bound.place
    flight = None
    if place is not None and region.bound.rises:
        flight = flight_outcome(search.samples, place, region)
    print_report(
        found_report(region, policy.words, flight, policy.not_covered, settings.reason), request
    )
    return 0


def _earlier(path: Path, loop: Loop, policy: str | Gain) -> BoxStatement:
    """Return the proved statement of the certificate that an earlier run wrote.

    path: file of the certificate

    Raises BadInputError if the statement concerns another loop or policy.
    """
    statement = check_certificate(path, loop.policy, ProgressLine("check"), loop.model).statement
    forget_read(path)
    if _subject(statement.loop, statement.policy) != _subject(loop, policy):
        raise BadInputError(f"{path} is the certificate of another loop; give another path with -o")
    return statement


def _subject(loop: Loop, policy: str | Gain) -> list[Any]:
    """Return the values that identify a loop: parameters, trim, inputs and policy."""
    stated = policy.content() if isinstance(policy, Gain) else policy
    return [dict(loop.parameters), dict(loop.trim), dict(loop.inputs), stated]


def check(
    request: OutputOptions,
    path: Path,
    linear: LinearModel,
    policy: ProvedPolicy,
    own: Model | None,
) -> int:
    """Verify a certificate for the user's policy, print a report and return exit code 0.

    path: file of the certificate
    linear: linear model at the user's trim
    policy: the user's policy
    own: the user's model, or None if the certificate concerns a built-in model

    Raises BadInputError if the certificate concerns another model or policy. Raises NoSolutionError
    if the statement is not proved or differs from the user's data.
    """
    verified = check_certificate(path, scalars(policy.function), ProgressLine("check"), own)
    content = verified.statement.content()
    compare(content, FIELDS, _given(loop_of(linear, policy), "the user"))
    show(checked_report(verified, policy.words, policy.not_covered), request)
    return 0


def _given(loop: Loop, option: str) -> dict[str, Given]:
    """Return entry of a statement -> the user's value, for every entry that describes the loop.

    option: the option that defined the loop, for messages
    """
    widths = {name: 1e-6 * signal.nominal for name, signal in loop.model.signals.items()}
    limits = {name: pair_of(ends) for name, ends in loop.limits.items()}
    given = {name: Given(fact, option) for name, fact in facts(loop.model).items()}
    given["parameters"] = Given(dict(loop.parameters), option)
    given["limits"] = Given(limits, option, lambda stated, own: bool(stated == own))
    given["policy"] = Given(digest_of(loop.policy), option)
    for name in ("trim", "inputs", "held"):
        given[name] = Given(dict(getattr(loop, name)), option, within(widths))
    return given
