"""The command `hfa assess`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from controller.critic.critic_file import critic_suffixes, is_network
from hfa.options.advice import trimmed
from hfa.options.argument_types import (
    each_of,
    input_file,
    linear_state,
    number,
    one_of,
    span,
    whole,
)
from hfa.options.command import Outcome, Request, command, picture_option
from hfa.options.option import is_given, option, refuse
from hfa.options.output import ProgressLine
from hfa.options.plants import aircraft_help
from hfa.options.trims import (
    GivenTrim,
    SeveralTrims,
    at_name,
    given_trims,
)
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario, Uncertainty
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.needs import ALL, OF_POLICY, SAMPLES, SHARE, needed_share
from hfa_flight.options import (
    EXACT,
    NONE,
    at_held_altitude,
    behind_a_filter,
    gust_at,
    gust_option,
    noise_of,
    noise_of_filter,
    noise_option,
    noted_game,
    noted_linear_model,
    policy_of_law,
    turbulence_option,
)
from hfa_flight.policies.laws import LAWS
from hfa_support.errors import BadInputError, choice_of
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_flight.judge.assessment import Assessment
    from hfa_flight.policies.deployment.deployed import Deployed
    from hfa_flight.policies.deployment.deployment import Deployment
    from hfa_flight.samples.monte_carlo import MonteCarlo

_MOST_POINTS = 1000
_MOST_SAMPLES = 100_000
#: Options of a deployment, which a law does not have.
_OF_DEPLOYMENTS = ("sample_time", "box", "vary", "best", "picture")


def _need(name: str, text: str) -> float:
    """Return the required value that is typed after --need, a number of at least 0."""
    from hfa_flight.judge.assessment import NEEDS

    if name not in NEEDS:
        raise BadInputError(f"is unknown; {choice_of(name, NEEDS)}")
    if name == SHARE:
        return needed_share(name, text)
    value = number(text)
    if value < 0.0:
        raise BadInputError(f"is {text}; give a number of at least 0")
    return value


def _half_width(model: Model, name: str, text: str) -> float:
    """Return the typed half-width of the initial-condition box, in the model's units."""
    width = linear_state(model, name, text)
    if width <= 0.0:
        raise BadInputError(f"is {text}; give a number above 0")
    return width


def _varied(model: Model, name: str, text: str) -> tuple[float, float]:
    """Return the lowest and highest value typed for a variation, in the model's units."""
    if name not in (*model.parameters, *model.inputs):
        return nan, nan
    return span(model, name, text)


def _deployment_path(text: str) -> Path:
    """Return the typed path of a deployment file, or of a file with a critic."""
    return input_file(*dict.fromkeys((".toml", *critic_suffixes())))(text)


@dataclass(frozen=True, kw_only=True, eq=False)
class AssessRequest(Request, SeveralTrims):
    """Arguments of `hfa assess`."""

    units: None = None
    aircraft: str | None = option(aircraft_help, "FILE.py:NAME", names="--model --aircraft")
    picture: Path | None = picture_option(
        "spectral radius versus delay, and outcomes of the flights"
    )
    file: Path | None = option(
        "deployment file (observations, actions and timing of a policy), or, with "
        "--sample-time, file with a gain K",
        "DEPLOYMENT.toml",
        _deployment_path,
        names="file",
        count="?",
    )
    sample_time: float | None = option(
        "sample time, s, of a gain K (u = -K x) in place of a deployment file",
        "S",
        number,
    )
    law: str | None = option(
        f"law in place of a file: {', '.join((NONE, EXACT, *LAWS))}",
        "NAME",
        one_of(NONE, EXACT, *LAWS),
    )
    samples: int | None = option(
        "initial conditions at each trim, each flown with and without the disturbance pulse; "
        f"default {SAMPLES}, law {OF_POLICY}",
        "N",
        whole(0, _MOST_SAMPLES),
    )
    seed: int = option(
        "seed of the initial conditions, noise and turbulence; default 0",
        "N",
        whole(0),
        default=0,
        rare=True,
    )
    box: Mapping[str, str] = option(
        "half-width of the initial-condition box in a state, degrees for angles; repeatable",
        "NAME=VALUE",
        named=True,
        rare=True,
    )
    need: Mapping[str, float] = option(
        "requirement: delay to tolerate (s), smallest disk margin, largest linear cost (percent "
        "above the optimum), or share of flights that converge (default 1); repeatable",
        "delay|margin|cost|share=X",
        _need,
        named=True,
    )
    vary: Mapping[str, str] = option(
        "interval of a parameter, or of an input that is not an action; the unchanged policy is "
        "also assessed at five values in this interval; repeatable",
        "NAME=LOW:HIGH",
        named=True,
        rare=True,
    )
    noise: Mapping[str, str] = noise_option(
        "standard deviation of the sensor noise of a state, degrees for angles; repeatable"
    )
    turbulence: Turbulence | None = turbulence_option()
    gust: tuple[float, ...] | None = gust_option()
    filter: bool = option(
        "Kalman filter of --noise and --turbulence before the policy in these flights; a state "
        "without noise has no sensor",
        rare=True,
    )
    best: int | None = option(
        "flights at each trim compared with the best flights found; 0: with the exact gain only; "
        "default 5 with [cost], else 0",
        "K",
        whole(0, _MOST_SAMPLES),
        rare=True,
    )


class _Given(NamedTuple):
    """What the options of `hfa assess` define of the aircraft.

    trims: the trims to assess
    source: entries of the provenance
    noise: state -> standard deviation of its sensor noise
    turbulence: turbulence, at the altitude of --hold
    """

    trims: list[GivenTrim]
    source: Mapping[str, Any]
    noise: Mapping[str, float]
    turbulence: Turbulence | None

    @property
    def model(self) -> Model:
        """The aircraft, with the parameters that the options set."""
        return self.trims[0].model


def _given(request: AssessRequest) -> _Given:
    """Return the trims, noise and turbulence of the options."""
    trims, source = given_trims(request, _MOST_POINTS)
    turbulence = at_held_altitude(request.turbulence, trims[0].hold)
    noise = noise_of(request.noise, trims[0].common.model)
    return _Given(trims, source, noise, turbulence)


def _deployment(request: AssessRequest, model: Model) -> Deployment:
    """Load the deployment.

    Raises BadInputError without a file, for a gain without a sample time, for a sample time
    without a gain, and as `sampled_gain` and `Deployment.load` do.

    model: aircraft of a gain
    """
    from hfa_flight.policies.deployment.deployment import Deployment, sampled_gain

    file = request.file
    if file is None:
        raise BadInputError(
            "no policy is given; give a deployment file, or add --law NAME with --noise or "
            "--turbulence"
        )
    if file.suffix.lower() == ".toml":
        if request.sample_time is not None:
            raise BadInputError(
                "--sample-time applies only to a file with a gain K; give a file with a gain "
                "K, or remove --sample-time"
            )
        return Deployment.load(file)
    if request.sample_time is not None:
        return sampled_gain(file, model, request.sample_time)
    if is_network(file):
        raise BadInputError(
            f"{file}: a network requires a deployment file, with the network as its "
            "[policy]; give the file FILE.toml"
        )
    raise BadInputError(f"{file}: a gain K requires a sample time; add --sample-time S")


def _filtered(deployment: Deployment, given: _Given) -> Deployment:
    """Return the deployment behind the filter of the noise and turbulence."""
    noise = noise_of_filter(given.noise)
    air = {} if given.turbulence is None else {"turbulence": given.turbulence.text}
    return deployment.changed(filter={"noise": noise, **air})


def _samples(request: AssessRequest) -> int:
    """Return the number of initial conditions at each trim of a deployment."""
    return SAMPLES if request.samples is None else request.samples


def _scenario_at(request: AssessRequest, given: _Given, point: OperatingPoint) -> Scenario:
    """Return the scenario with noise, gust and turbulence at a trim."""
    uncertainty = Uncertainty(noise=given.noise, turbulence=given.turbulence)
    scenario = Scenario(uncertainty=uncertainty)
    gust = gust_at(request.gust, point, scenario.duration)
    return replace(scenario, gust=gust)


def _assumed_trim(request: AssessRequest, point: OperatingPoint) -> str:
    """Return a note on the default trim, or "" if an option names the trim."""
    named = ("at", "dihedral", "hold", "condition", "start")
    if not point.model.schedule or any(is_given(request, name) for name in named):
        return ""
    return (
        f"no --{at_name(point.model)} is given: the default trim {point.at_scheduled} is assessed"
    )


@command(AssessRequest, _given)
def assess(request: AssessRequest, given: _Given) -> Outcome:
    """Assess a policy as deployed: sampled and held, with normalizer and delay.

    For each trim, the report contains the equilibrium, the spectral radius of the sampled loop with
    0, 1, 2 ... samples of delay, margins at the plant's input, and the linear cost compared with
    the optimum for Q and R. Flights from a box of initial conditions are simulated with and without
    a disturbance pulse. The first line compares costs with the best flights', or the exact gain's.

    With --policy, the flights and their report are those of `hfa fly --policy NAME --samples N`.

    Exit code 0 if the policy holds at every trim and satisfies every --need, else 1.
    """
    from hfa_flight.policies.deployment.deployed import Deployed

    if request.law is not None:
        return _assess_law(request, given)
    deployment = _deployment(request, given.model)
    if request.filter:
        deployment = _filtered(deployment, given)
    deployed = Deployed(deployment, given.model)
    result = _assessment(request, given, deployed)
    return Outcome(
        report=result.report(),
        ok=result.ok,
        source=given.source,
        notes=result.warnings,
        figure=result.figure,
    )


def _assess_law(request: AssessRequest, given: _Given) -> Outcome:
    """Return the outcome of the flights of a law from each trim."""
    from hfa_flight.samples.flights_in_air import flights_in_air

    _refuse_of_law(request)
    plans = [_plan_of_law(request, given, trimmed(each)) for each in given.trims]
    assumed = _assumed_trim(request, plans[0].point)
    flown = flights_in_air(plans)
    notes = filter(None, (assumed, *flown.warnings))
    return Outcome(report=flown.report(), ok=flown.ok, source=given.source, notes=[*notes])


def _refuse_of_law(request: AssessRequest) -> None:
    """Raise BadInputError for options that a law does not have, and if all flights are the same."""
    if request.file is not None:
        raise BadInputError(f"{request.file} and --law both give a policy; remove one of the two")
    refuse(request, _OF_DEPLOYMENTS, "cannot be combined with --law; remove one of the two")
    for name in request.need:
        if name != SHARE:
            raise BadInputError(
                f"--need {name} cannot be combined with --law; remove one of the two"
            )
    if request.turbulence is None and not request.noise:
        raise BadInputError(
            "--law has the same flight from a trim each time; add --noise STATE=VALUE or "
            "--turbulence LEVEL:ALTITUDE"
        )
    if request.samples == 0:
        raise BadInputError("--samples is 0, so --law has no flights; give at least 1")
    if request.filter and request.law == NONE:
        raise BadInputError(f"--filter requires a policy; remove --law {NONE}")


def _plan_of_law(request: AssessRequest, given: _Given, point: OperatingPoint) -> MonteCarlo:
    """Return the plan of the flights of a law from a trim."""
    from hfa_flight.judge.assess import plan_of

    scenario = _scenario_at(request, given, point)
    policy = None
    if request.law is not None and request.law != NONE:
        game = noted_game({}, noted_linear_model(point.model, point))
        policy = policy_of_law(request.law, game, point, is_filtered=request.filter)
    if policy is not None and request.filter:
        policy = behind_a_filter(policy, scenario, point)
    samples = OF_POLICY if request.samples is None else request.samples
    share = request.need.get(SHARE, ALL)
    return plan_of(policy, point, scenario, samples, request.seed, share)


def _assessment(request: AssessRequest, given: _Given, deployed: Deployed) -> Assessment:
    """Return the assessment of a deployment."""
    from hfa_flight.judge.assess import assessment_of
    from hfa_flight.judge.assessor import Assessor
    from hfa_flight.judge.variations import changes_of

    model = given.model
    changes = changes_of(deployed, each_of("--vary", model, request.vary, _varied))
    box = each_of("--box", model, request.box, _half_width)
    points = tuple(trimmed(each) for each in given.trims)
    in_air = bool(given.noise) or given.turbulence is not None or request.gust is not None
    scenarios = [_scenario_at(request, given, point) for point in points] if in_air else []
    share = request.need.get(SHARE, ALL)
    assessor = Assessor(deployed, points, _samples(request), request.seed, box, share=share)
    result = assessment_of(
        assessor,
        needs=request.need,
        changes=changes,
        scenarios=scenarios,
        best=request.best,
        progress_of=ProgressLine,
    )
    return replace(result, assumed=_assumed_trim(request, points[0]))
