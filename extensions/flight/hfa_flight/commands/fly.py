"""The command `hfa fly`: one flight, or many flights with random differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.gare import solve
from hfa.options.advice import trimmed
from hfa.options.argument_types import each_of, number, quantity, span, whole
from hfa.options.command import (
    Outcome,
    ProgressLine,
    Request,
    WorkerOptions,
    command,
    picture_option,
)
from hfa.options.games import REFERENCE, deviation_signal, given_weights, weighted_game
from hfa.options.parser import option, refuse
from hfa.options.plants import parameter_spread
from hfa.options.trims import GivenTrim, given_trim
from hfa_aircraft.batch_simulation import Cost
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.waveform import Waveform, stacked
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.scenario import Scenario, with_errors
from hfa_flight.air.signals import TimeVector
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.needs import ALL, SHARE, needed_share
from hfa_flight.options import (
    DEPLOYMENT,
    NONE,
    TABLE,
    PolicyOptions,
    ScenarioOptions,
    at_held_altitude,
    behind_a_filter,
    check_policy,
    noted_game,
    noted_linear_model,
    policy_of_options,
    policy_of_word,
    require_policy,
    scenario_of,
    turbulence_option,
)
from hfa_flight.policies.given import command_steps
from hfa_flight.policies.laws import LAWS
from hfa_flight.policies.policy import GainPolicy, Policy, open_loop
from hfa_flight.simulate.closed_loop import FlightLoop, NonlinearPlant
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.flight import Flight, lengthened, simulated_loop
from hfa_support.errors import BadInputError, warn
from hfa_support.reporting.report import Report
from hfa_support.reporting.results import Entries
from hfa_support.reporting.text import Table, shown_unit, shown_value
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.tracking import Tracking


def tracking_of(
    linear: LinearModel,
    game: Game,
    policy: Policy,
    reference: Mapping[str, Waveform],
    duration: float,
) -> Tracking:
    """Return the tracking of a reference by the gain of a policy and the feedforward of a game.

    Raises BadInputError for a policy without a constant gain.
    """
    if not isinstance(policy, GainPolicy) or policy.gain is None:
        raise BadInputError(
            f"--reference requires a policy u = -K z, not the {policy.name}; give a file with a "
            "gain K, as `hfa solve -o FILE` writes without --order, or --policy exact"
        )
    from controller.tracking import tracked

    commands = stacked(reference, linear.states)
    return tracked(linear, solve(game), policy.gain, commands, duration)


def with_tracking_errors(
    report: Report, tracking: Tracking, flown: Flight, plain: Flight
) -> Report:
    """Return the report of a policy with a section on its tracking errors.

    flown: the flight with feedforward
    plain: the flight without feedforward
    """
    names = tracking.game.names
    late, plain_late = (
        np.array([each.rms_error[state] for state in names.states]) for each in (flown, plain)
    )
    rows = []
    for state, unit, *values in zip(names.states, names.state_units, late, plain_late, strict=True):
        shown = (shown_value(float(value), unit, ".3g") for value in values)
        rows.append((state, shown_unit(unit), *shown))
    header = ("rms error, 2nd half", "unit", "flight", "without feedforward")
    parts = [*report.parts, tracking.report().title, Table(header, rows)]
    for flight, which in ((flown, "With"), (plain, "Without")):
        if flight.departure is not None:
            parts.append(f"{which} feedforward, the flight {flight.departure.text()}")
    errors = {"late_rms_errors": late, "late_rms_errors_without_feedforward": plain_late}
    return replace(report, parts=(*parts, *tracking.trim_parts())).with_data(
        errors, tracking=tracking
    )


_MOST_MEMBERS = 10_000_000
#: Form of --command in the help.
_COMMAND = "NAME=TIME:VALUE[,TIME:VALUE...]"


def _command(model: Model, name: str, text: str) -> list[tuple[float, float]]:
    """Return the steps of a command: pairs (time in s, value)."""
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise BadInputError(f"is {text!r}; give {_COMMAND}")
    return [(number(time), quantity(model, name, value)) for time, value in pairs]


class PlannedFlight(NamedTuple):
    """A flight to be simulated.

    point: the trim
    envelope: limits of the states
    tracking: feedback and feedforward of --reference, or None
    """

    point: OperatingPoint
    policy: Policy
    scenario: Scenario
    envelope: Limits
    tracking: Tracking | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class FlyRequest(Request, PolicyOptions, ScenarioOptions, WorkerOptions):
    """Options of `hfa fly`."""

    needs_dihedral = True
    usual = (
        *("policy", "initial", "turbulence", "samples", "noise", "filter", "gust", "command"),
        *("duration", "aircraft", "at", "hold"),
    )
    picture: Path | None = picture_option("the flight")
    command: Mapping[str, str] = option(
        f"steps of an input (--policy {NONE}) or of the angle of a gain table: times, s, and "
        "deviations",
        _COMMAND,
        named=True,
    )
    reference: Mapping[str, str] = REFERENCE
    filter: bool = option(
        "Kalman filter before the policy, for sensors with --noise and for --turbulence",
        rare=True,
    )
    filter_turbulence: Turbulence | None = turbulence_option(
        "turbulence that --filter assumes; default that of --turbulence"
    )
    samples: int | None = option(
        "simulate N flights with own random errors and air",
        "N",
        whole(1, _MOST_MEMBERS),
        rare=True,
    )
    draws: int | None = option(
        "simulate N aircraft whose uncertain parameters are drawn at random",
        "N",
        whole(1),
        rare=True,
    )
    need: Mapping[str, float] = option(
        "share of the flights of --samples or --draws that must stay within limits for exit code "
        "0; default 1, all",
        f"{SHARE}=X",
        needed_share,
        named=True,
        rare=True,
    )


@command(FlyRequest, given_trim)
def fly(request: FlyRequest, given: GivenTrim) -> Outcome:
    """Simulate a policy on the nonlinear aircraft, and compare the flight with the linear model.

    `--policy none --command elevator=1:2,2:-2,3:0` simulates a doublet without a policy.
    --reference adds the exact feedforward. --draws N simulates N aircraft with random parameters.
    --Q and --R add the cost of the flight.

    Exit code 1 if a state leaves its envelope, an input exceeds its control limits, or an
    oscillation does not decay. Of several flights, every one must pass, or the share of --need.
    """
    members = request.samples if request.draws is None else request.draws
    if members is not None:
        return _fly_members(request, given, members)
    return _fly_once(request, given)


def _fly_once(request: FlyRequest, given: GivenTrim) -> Outcome:
    """Return the outcome of a single flight."""
    from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
    from trim.linear.linearize import linearize

    only_many = "applies only to --samples or --draws; remove this option"
    refuse(request, ("workers", "need"), only_many)
    _refuse_contradictions(request)
    point, policy, scenario, envelope, tracking = _planned(request, given, trimmed(given))
    model = point.model
    weights = None
    # The first line of a law's report has the cost of the flight.
    is_law = request.kind in LAWS
    if is_law or request.Q is not None or request.R is not None or request.sizes:
        named = weighted_game(
            given_weights(request, model), linearize(model, point), of_flights=is_law
        )
        game = named.game
        weights = Cost(game.Q, game.R)
    plant = NonlinearPlant(with_errors(model, scenario), point)
    loop = FlightLoop(plant, policy, scenario, weights, envelope)
    if request.duration is None:
        loop = replace(loop, scenario=lengthened(loop))
    # With scheduled gains, the linear model at the first trim does not apply to other trims.
    predict = not isinstance(policy, ScheduledGainPolicy)
    progress = ProgressLine("simulate")
    result = simulated_loop(loop, predict=predict, progress=progress)

    report = result.report()
    if is_law:
        first, *rest = report.title.split("\n")
        report = replace(report, title="\n".join([f"{first}; {_end_of(result)}", *rest]))
    if tracking is not None:
        # The same gain about the same reference, without the feedforward of the inputs.
        loop = replace(loop, policy=GainPolicy(policy.name, tracking.K))
        without_feedforward = simulated_loop(loop, predict=predict, progress=progress)
        report = with_tracking_errors(report, tracking, result, without_feedforward)
    return Outcome(
        report=report,
        ok=result.ok,
        source=given.source,
        notes=result.warnings,
        figure=lambda: result.figure(report.title),
        only_in_files=Entries(lambda: {"history": result.history()}),
    )


def _refuse_contradictions(request: FlyRequest, many: bool = False) -> None:
    """Raise BadInputError if options contradict each other or have no effect.

    many: whether they are those of --samples or --draws
    """
    # Of a single flight, --Q and --R are the weights of its cost.
    check_policy(request, weights=() if many else ("Q", "R", "sizes"))
    beside = "cannot be combined with --{}; remove one of the two"
    if request.reference:
        require_policy(request, "--reference")
        refuse(request, ("keep_inside", "filter"), beside.format("reference"))
    if not request.filter:
        refuse(request, ("rate", "filter_turbulence"), "applies only with --filter; add --filter")
    if request.filter:
        require_policy(request, "--filter")
        refuse(request, ("keep_inside",), beside.format("filter"))
    if request.keep_inside:
        refuse(request, ("command",), beside.format("keep-inside"))
    is_random = request.turbulence is not None or bool(request.noise)
    if not (many or is_random):
        only = "applies only to --turbulence, --noise, --samples and --draws; remove this option"
        refuse(request, ("seed",), only)


def _planned(
    request: FlyRequest, given: GivenTrim, point: OperatingPoint, many: bool = False
) -> PlannedFlight:
    """Return the flight to be simulated, as specified by the options.

    many: whether it is simulated many times, each time with its own random quantities
    """
    scenario = scenario_of(request, point, given.hold, drawn=many)
    commands = each_of("--command", given.model, request.command, _command)
    for name, steps in commands.items():
        begin = min(time for time, _ in steps)
        if begin >= scenario.duration:
            raise BadInputError(
                f"--command {name} begins at {begin:g} s, not before the end of the flight at "
                f"{scenario.duration:g} s; give {_COMMAND} with an earlier time, or a longer "
                "--duration"
            )
    limits = each_of("--envelope", in_gusts(given.model), request.envelope, span)
    steering = _steering(request, given, point, commands, limits, scenario.duration)
    policy, reference, tracking = steering
    if reference is not None:
        scenario = replace(scenario, reference=reference)
    if request.keep_inside:
        from hfa_flight.plan.state_dependent import keep_inside

        policy = keep_inside(policy, point.model, point, limits=limits)
    if request.filter:
        flown = scenario.uncertainty
        air = at_held_altitude(request.filter_turbulence, given.hold) or flown.turbulence
        policy = behind_a_filter(policy, point, flown.noise, air, scenario.interval)
    policy, scenario = policy.in_scenario(scenario)
    if not many:
        scenario = scenario.drawn(request.seed, 0, point)
    envelope = flight_envelope(given.model, point, limits)
    return PlannedFlight(point, policy, scenario, envelope, tracking)


class _Steering(NamedTuple):
    """What moves the inputs of a flight, with the reference x_d and its tracking, if any."""

    policy: Policy
    reference: TimeVector | None = None
    tracking: Tracking | None = None


def _steering(
    request: FlyRequest,
    given: GivenTrim,
    point: OperatingPoint,
    commands: Mapping[str, list[tuple[float, float]]],
    limits: Mapping[str, tuple[float, float]],
    duration: float,
) -> _Steering:
    """Return the policy that the options specify, with its reference and tracking.

    commands: name -> steps (time, value) of --command
    limits: state -> (lowest, highest) of --envelope
    duration: of the flight, s
    """
    model = given.model
    if request.flown == NONE:
        if request.policy is None:
            warn(f"no --policy is given: no policy acts (--policy {NONE})")
        return _Steering(open_loop(command_steps(commands), tuple(model.inputs)))
    linear = noted_linear_model(model, point)
    # Deployments and tables of gains follow commands themselves; a law follows none.
    if request.kind in (DEPLOYMENT, TABLE):
        steps = command_steps(commands)
        return _Steering(policy_of_options(request, linear, given.common.at, steps))
    if request.kind in LAWS:
        game = noted_game(given_weights(request, model), linear, of_flights=True)
        settings = {"horizon": request.horizon, "margin": request.margin}
        return _Steering(policy_of_word(request.kind, game, point, limits, **settings))
    # A constant gain follows a reference with feedforward.
    signals = each_of("--reference", model, request.reference, deviation_signal)
    policy = policy_of_options(request, linear)
    if not signals:
        return _Steering(policy)
    game = weighted_game(given_weights(request, model), linear).game
    tracking = tracking_of(linear, game, policy, signals, duration)
    policy = GainPolicy(policy.name, tracking.K, tracking.inputs)
    return _Steering(policy, tracking.exact.reference, tracking)


def _end_of(result: Flight) -> str:
    """Return the end of the first line for a law: whether the flight returned, and its cost, also
    relative to that of its first plan, if the law plans.
    """
    ended = "returned" if result.returned else "not returned"
    first = result.loop.policy.data(result.model).get("samples", {}).get("first_plan")
    ratio = f", {result.cost / first:.4g} times its first plan" if first else ""
    return f"{ended}, cost {result.cost:.4g}{ratio}"


def _fly_members(request: FlyRequest, given: GivenTrim, members: int) -> Outcome:
    """Return the outcome of the flights of --samples or --draws."""
    from hfa_flight.samples.fly import flights_in_air
    from hfa_flight.samples.monte_carlo import MonteCarlo

    _refuse_of_members(request)
    _refuse_contradictions(request, many=True)
    spread = None
    if request.draws is not None:
        # The parameters that the trim imposes are not drawn.
        held = given.hold if given.at is None else (*given.hold, given.model.schedule)
        spread = parameter_spread(request, given.common.model, held)
    point, policy, scenario, envelope, _ = _planned(request, given, trimmed(given), many=True)
    plan = MonteCarlo(
        members,
        request.seed,
        point.model,
        point,
        policy,
        scenario,
        envelope,
        spread=spread,
        share=request.need.get(SHARE, ALL),
    )
    flights = flights_in_air(plan, request.workers)
    notes = flights.warnings
    report = flights.report().with_data(warnings=notes)
    return Outcome(
        report=report,
        ok=report.data["ok"],
        source=given.source,
        notes=notes,
        only_in_files={"flights": flights.flown},
    )


def _refuse_of_members(request: FlyRequest) -> None:
    """Raise BadInputError for options that many flights do not have."""
    if request.kind in LAWS or request.keep_inside:
        planned = "cannot be combined with a policy that plans or with --keep-inside"
        refuse(request, ("workers",), f"{planned}; remove --workers")
    if request.draws is not None:
        both = "and --draws both set the number of flights; remove one of these options"
        refuse(request, ("samples",), both)
    refuse(request, ("picture",), "applies only to a single flight; remove this option")
