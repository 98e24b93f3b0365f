"""The command `hfa assess`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from controller.critic.critic_file import critic_suffixes
from hfa.options.advice import trimmed
from hfa.options.argument_types import each_of, input_file, linear_state, number, whole
from hfa.options.command import Outcome, Request, command
from hfa.options.parser import is_given, option
from hfa.options.plants import aircraft_help
from hfa.options.trims import GivenTrims, SeveralTrims, at_name, given_trims
from hfa_flight.needs import NEEDS, SAMPLES, needed
from hfa_flight.options import SensorOptions, sensors_of_options
from hfa_support.errors import BadInputError
from hfa_support.files import POSITIVE
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_flight.policies.deployment.deployment import Deployment

_MOST_POINTS = 1000
_MOST_SAMPLES = 100_000


def _deployment_path(text: str) -> Path:
    """Return the typed path of a deployment file, or of a file with a critic."""
    # A critic may be in a .toml file too; the dictionary has each suffix once.
    return input_file(*dict.fromkeys((".toml", *critic_suffixes())))(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class AssessRequest(Request, SeveralTrims, SensorOptions):
    """Arguments of `hfa assess`."""

    units: None = None
    aircraft: str | None = option(aircraft_help, "FILE.py:NAME")
    file: Path | None = option(
        "deployment file (observations, actions and timing of a policy), or, with "
        "--sample-time, file with a policy u(x): a gain K, a table of gains or a network",
        "DEPLOYMENT.toml",
        _deployment_path,
        names="file",
        count="?",
    )
    sample_time: float | None = option(
        "sample time, s, of a policy u(x) of the deviations x from the trim, in place of a "
        "deployment file",
        "S",
        number,
    )
    samples: int = option(
        "initial conditions at each trim, each flown with and without the disturbance pulse; "
        f"default {SAMPLES}",
        "N",
        whole(0, _MOST_SAMPLES),
        default=SAMPLES,
    )
    seed: int = option(
        "seed of the initial conditions; default 0", "N", whole(0), default=0, rare=True
    )
    box: Mapping[str, str] = option(
        "half-width of the initial-condition box in a state, degrees for angles; repeatable",
        "NAME=VALUE",
        named=True,
        rare=True,
    )
    need: Mapping[str, float] = option(
        "requirement: delay to tolerate (s), smallest disk margin, largest median cost (percent "
        "above the exact gain's), or share of flights that converge (default 1); repeatable",
        "delay|margin|cost|share=X",
        partial(needed, tuple(NEEDS)),
        named=True,
    )


def _deployment(request: AssessRequest, points: Sequence[OperatingPoint]) -> Deployment:
    """Load the deployment, or the policy u(x) of an aircraft with the sample time of the option."""
    from hfa_flight.policies.deployment.deployment import Deployment
    from hfa_flight.policies.given import sampled_policy

    file = request.file
    if file is None:
        raise BadInputError(
            "no policy is given; give a deployment file, or a file with a policy u(x) and its "
            "--sample-time S"
        )
    if file.suffix.lower() == ".toml":
        if request.sample_time is not None:
            raise BadInputError(f"{file} states its sample time, timing.dt; remove --sample-time")
        return Deployment.load(file)
    if request.sample_time is None:
        raise BadInputError(
            f"{file}: a policy u(x) requires a sample time; add --sample-time S, or give a "
            "deployment file, if its inputs are not the deviations from the trim"
        )
    return sampled_policy(file, points[0].model, request.sample_time, points)


def _assumed_trim(request: AssessRequest, point: OperatingPoint) -> str:
    """Return a note on the default trim, or "" if an option names the trim."""
    named = ("at", "dihedral", "hold", "condition", "start")
    if not point.model.schedule or any(is_given(request, name) for name in named):
        return ""
    return (
        f"no --{at_name(point.model)} is given: the default trim {point.at_scheduled} is assessed"
    )


@command(AssessRequest, partial(given_trims, most=_MOST_POINTS))
def assess(request: AssessRequest, given: GivenTrims) -> Outcome:
    """Assess a policy as deployed: with a zero-order hold, normalizer and delay.

    For each trim, the report contains the equilibrium, the spectral radius of the sampled loop with
    0, 1, 2 ... samples of delay, and margins at the plant's input. Flights from a box of initial
    conditions are simulated with and without a disturbance pulse, and decide. The first line
    compares their costs with the exact gain's.

    --sensors, --noise and --bias are errors of what the policy sees; its flights then need to stay
    within the limits only. Flights in moving air, and of a policy behind a filter, are those of
    `hfa fly --policy FILE --samples N`.

    Exit code 0 if the policy holds at every trim and satisfies every --need, else 1.
    """
    from hfa_flight.judge.assessment import assess

    model = given.trims[0].model
    box = each_of("--box", model, request.box, partial(linear_state, declared=POSITIVE))
    points = tuple(map(trimmed, given.trims))
    result = assess(
        model,
        _deployment(request, points),
        points,
        request.samples,
        request.seed,
        box=box,
        needs=request.need,
        sensors=sensors_of_options(request, model),
    )
    result = replace(result, assumed=_assumed_trim(request, points[0]))
    return Outcome(report=result.report(), ok=result.ok, source=given.source, notes=result.warnings)
