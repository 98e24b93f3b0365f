"""The command `hfa fly`: one flight, or many flights with random differences."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa.options.aircraft import Aircraft
from hfa.options.argument_types import (
    number,
    quantity,
    whole,
)
from hfa.options.output import Output, ProgressLine, output_option, picture_option
from hfa.options.part import OfModel, option, part
from hfa.options.reference import reference_option
from hfa.options.request import Request, command
from hfa.options.trim import Trim
from hfa.options.workers import Workers
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.waveform import Waveform
from hfa_flight.air.scenario import Scenario, with_errors
from hfa_flight.air.signals import CommandedStates
from hfa_flight.needs import ALL, SHARE, is_enough, needed_share
from hfa_flight.options import NONE, PolicyGiven, ScenarioGiven, noted_linear_model
from hfa_flight.policies.laws import LAWS
from hfa_flight.simulate.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.simulate.envelope import flight_envelope
from hfa_flight.simulate.flight import lengthened
from hfa_support.errors import BadInputError, refuse_unknown, warn
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_flight.policies.policy import Policy
    from hfa_flight.samples.monte_carlo import MonteCarlo
    from hfa_flight.simulate.flight import Flight

_MOST_MEMBERS = 10_000_000
_MOST_STEPS = 1_000_000
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
    """

    model: Model
    point: OperatingPoint
    policy: Policy
    scenario: Scenario
    envelope: Limits

    def lengthened(self) -> PlannedFlight:
        """Return the flight, longer if limit cycles of growing modes require it."""
        plant = NonlinearPlant(with_errors(self.model, self.scenario), self.point)
        loop = ClosedLoop(plant, self.policy, self.scenario)
        return self._replace(scenario=lengthened(loop))


@dataclass(frozen=True, kw_only=True, eq=False)
class FlyRequest(Request):
    """Options of `hfa fly`."""

    aircraft: Aircraft = part(Aircraft)
    trim: Trim = part(Trim)
    policy: PolicyGiven = part(PolicyGiven)
    scenario: ScenarioGiven = part(ScenarioGiven)
    processes: Workers = part(Workers)
    output: Output = part(
        Output,
        file=output_option(stores=(".zarr",), purpose=" (flights of --samples or --draws)"),
        picture=picture_option("the flight, or the flights of --draws"),
    )
    command: Mapping[str, list[tuple[float, float]]] = option(
        f"steps of a state, or with --law {NONE} of an input: times, s, and deviations from the "
        "trim",
        _COMMAND,
        OfModel(_command),
        named=True,
    )
    reference: Mapping[str, Waveform] = reference_option()
    filter: bool = option(
        "Kalman filter before the policy, for the --noise of the sensors (a state without noise "
        "has no sensor) and the --turbulence; --samples compares with no control",
        default=False,
        rare=True,
    )
    samples: int | None = option(
        "simulate N flights, each with its own random errors, noise and turbulence",
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

    @property
    def members(self) -> int | None:
        """Number of flights with random differences, or None for a single flight."""
        return self.samples if self.draws is None else self.draws

    def _refuse_late_commands(self, duration: float) -> None:
        """Raise BadInputError for a command that begins at the end of the flight or later."""
        for name, steps in self.command.items():
            begin = min(time for time, _ in steps)
            if begin >= duration:
                raise BadInputError(
                    f"--command {name} begins at {begin:g} s, not before the end of the flight at "
                    f"{duration:g} s; give {_COMMAND} with an earlier time, or a longer --duration"
                )

    def flight(self) -> PlannedFlight:
        """Return the flight to be simulated, as specified by the options.

        Raises BadInputError if the options contradict each other.
        """
        from hfa_flight.commands.tracking import tracking_of
        from hfa_flight.policies.filtered_policy import behind_own_filter
        from hfa_flight.policies.given import command_steps
        from hfa_flight.policies.policy import GainPolicy, open_loop
        from hfa_flight.policies.scheduled_gains import scheduled_gains
        from hfa_flight.schedule.gain_schedule import load_gain_schedule

        given = self.policy
        if self.reference:
            self.refuse(
                ("command", "policy.controller", "policy.deployment"),
                "cannot be combined with --reference; remove one of these options",
            )
            given.require("--reference")
        # Of a single flight, --Q and --R are the weights of its cost.
        prices = ("policy.game.Q", "policy.game.R") if self.members is None else ()
        given.check(self, prices)
        is_random = self.scenario.turbulence is not None or any(self.scenario.noise.values())
        if self.members is None and not is_random:
            self.scenario.refuse(
                ("seed",),
                "applies only to --turbulence, --noise, --samples and --draws; remove this option",
            )
        model = self.trim.aircraft
        point = self.trim.point()
        scenario = self.scenario.scenario(point, self.trim.hold, drawn=self.members is not None)
        self._refuse_late_commands(scenario.duration)
        steps = command_steps(self.command)
        reference: Any = None
        policy: Policy
        if given.deployment is not None:
            policy = behind_own_filter(given.deployment, point)
        elif given.controller is not None:
            schedule = load_gain_schedule(given.controller, model)
            name = f"gains of {given.controller}"
            condition = self.trim.common_condition.at
            policy = scheduled_gains(name, schedule, point, condition, steps)
        elif given.flown_law == NONE:
            if not given.law:
                warn(f"no --law is given: no policy acts (--law {NONE})")
            policy = open_loop(steps, tuple(model.inputs))
        elif given.flown_law in LAWS:
            self.refuse(
                ("command", "reference"),
                f"cannot be combined with --law {given.law}; remove this option",
            )
            linear = noted_linear_model(model, point)
            limits = self.scenario.envelope
            policy = given.planning(linear, limits)
        else:
            for name in steps.names:
                refuse_unknown("a gain cannot follow a command of", name, model.linear)
            if steps.names:
                reference = CommandedStates(steps, model.linear)
            linear = noted_linear_model(model, point)
            policy = given.about(linear)
            if self.reference:
                game = given.game.game(linear)
                tracking = tracking_of(linear, game, policy, self.reference)
                policy = GainPolicy(policy.name, tracking.K, tracking.inputs)
                reference = tracking.exact.reference
        if reference is not None:
            scenario = replace(scenario, reference=reference)
        if given.keep_inside:
            self.refuse(
                ("command", "reference", "policy.controller"),
                "cannot be combined with --keep-inside; remove one of the two",
            )
            policy = given.kept(policy, point, scenario)
        if self.filter:
            policy = self._filtered(policy, scenario)
        policy, scenario = policy.in_scenario(scenario)
        if self.members is None:
            scenario = scenario.drawn(self.scenario.seed, 0, point)
        envelope = flight_envelope(model, point, self.scenario.envelope)
        return PlannedFlight(model, point, policy, scenario, envelope)

    def _filtered(self, policy: Policy, scenario: Scenario) -> Policy:
        """Return the policy behind the filter of the scenario's noise and turbulence.

        Raises BadInputError for options that contradict the filter.
        """
        from hfa_flight.policies.filtered_policy import own_sample_time
        from hfa_flight.policies.kalman import filter

        self.refuse(
            ("command", "reference", "policy.keep_inside", "policy.controller"),
            "cannot be combined with --filter; remove one of the two",
        )
        self.policy.require("--filter")
        noise = {name: value for name, value in self.scenario.noise.items() if value}
        if not noise:
            raise BadInputError(
                "--filter requires the noise of the sensors; add --noise STATE=VALUE for each "
                "measured state"
            )
        linear = self.trim.point().linearize()
        dt = own_sample_time(policy, scenario.tick)
        return filter(linear, noise, scenario.uncertainty.turbulence, dt).policy(policy)


@command(FlyRequest)
def fly(request: FlyRequest) -> int:
    """Simulate a policy on the nonlinear aircraft, and compare the flight with the linear model.

    `--law none --command elevator=1:2,2:-2,3:0` simulates a doublet without a policy. --reference
    adds the exact feedforward, and a flight without it. --samples N simulates N flights, with
    --error and --noise as standard deviations; --draws N simulates N aircraft with random
    parameters. --Q and --R add the cost of the flight.

    Exit code 1 if a state leaves its envelope, an input exceeds its control limits, or an
    oscillation does not decay. Of several flights, every one must pass, or the share of --need.
    """
    if request.members is not None:
        return _fly_members(request)
    from hfa_flight.policies.scheduled_gains import ScheduledGainPolicy
    from hfa_flight.simulate.flight import fly
    from hfa_flight.simulate.flight_report import flight_figure
    from trim.point.linearize import linearize

    request.processes.refuse(
        ("workers", "resume"), "applies only to --samples or --draws; remove this option"
    )
    request.refuse(("need",), "applies only to --samples or --draws; remove this option")
    file = request.output.file
    if file is not None and file.suffix == ".zarr":
        raise BadInputError(
            f"{file} is a store for the flights of --samples or --draws; add --samples N"
        )
    planned = request.flight()
    if "scenario.duration" not in request.typed:
        planned = planned.lengthened()
    if request.trim.at is None and request.model.about.names_schedule:
        warn(f"no --{request.model.schedule} is given: the flight is {planned.point.at_scheduled}")
    # With scheduled gains, the linear model at the first trim does not apply to other trims.
    predict = not isinstance(planned.policy, ScheduledGainPolicy)
    weights = None
    plans = request.policy.flown_law in LAWS
    if plans or {"policy.game.Q", "policy.game.R"} & request.typed.keys():
        game = request.policy.game.game(linearize(planned.model, planned.point))
        weights = (game.Q, game.R)
    simulated = partial(
        fly,
        planned.model,
        planned.point,
        scenario=planned.scenario,
        envelope=planned.envelope,
        predict=predict,
        weights=weights,
        progress=ProgressLine("simulate"),
    )
    result = simulated(planned.policy)
    report = result.report()
    if plans:
        first, *rest = report.title.split("\n")
        report = replace(report, title="\n".join([f"{first}; {_end_of(result)}", *rest]))
    if request.reference:
        from hfa_flight.commands.tracking import tracking_of, with_errors
        from hfa_flight.policies.policy import GainPolicy

        linear = linearize(planned.model, planned.point)
        game = request.policy.game.game(linear)
        tracking = tracking_of(linear, game, planned.policy, request.reference)
        plain = simulated(GainPolicy(planned.policy.name, tracking.K))
        report = with_errors(report, tracking, result, plain)
    request.show(
        report,
        figure=lambda: flight_figure(result, report.title),
        only_in_files={"history": result.history()},
        notes=result.warnings,
    )
    return 0 if result.ok else 1


def _end_of(result: Flight) -> str:
    """Return the phrase on where the flight of a law that plans ends, and its cost, with the ratio
    to the cost of the law's first plan, if it has one.
    """
    ended = "returned" if result.returned else "not returned"
    first = result.loop.policy.data(result.model).get("samples", {}).get("first_plan")
    ratio = f", {result.cost / first:.4g} times its first plan" if first else ""
    return f"{ended}, cost {result.cost:.4g}{ratio}"


def _fly_members(request: FlyRequest) -> int:
    """Simulate the flights of --samples or --draws, print the report and return the exit code."""
    from hfa_flight.samples.drawn_aircraft import drawn_figure
    from hfa_flight.samples.monte_carlo import MonteCarlo
    from hfa_flight.samples.report import member_report
    from hfa_flight.samples.stability import with_stability
    from hfa_flight.samples.store import run_monte_carlo, stream_members

    if request.policy.flown_law in LAWS or request.policy.keep_inside:
        request.processes.refuse(
            ("workers",),
            "cannot be combined with a law that plans or with --keep-inside; remove --workers",
        )
    members = request.members
    assert members is not None  # --samples or --draws is given
    if request.draws is not None:
        request.refuse(
            ("samples",),
            "and --draws both set the number of flights; remove one of these options",
        )
    target = request.output.file
    if request.draws is None:
        request.output.refuse(
            ("picture",),
            "applies only to a single flight or --draws; remove this option or --samples",
        )
    if target is not None and target.suffix != ".zarr":
        raise BadInputError(
            f"{target}: the flights of --samples and --draws are written to a Zarr store; use -o "
            "FILE.zarr"
        )
    if request.processes.resume and target is None:
        raise BadInputError("--resume requires a store; add -o FILE.zarr")
    share = request.need.get(SHARE, ALL)
    spread = None
    if request.draws is not None:
        spread = request.aircraft.spread(request.trim.held_parameters)
    plan = MonteCarlo(members, request.scenario.seed, *request.flight(), spread, share)
    progress = ProgressLine("simulate")
    if target is None:
        flown = run_monte_carlo(plan, request.processes.workers, progress)
        report = member_report(plan, flown.__getitem__, "flights not kept", _uncontrolled(plan))
    else:
        dataset = stream_members(
            plan,
            target,
            workers=request.processes.workers,
            resume=request.processes.resume,
            provenance=request.provenance.to_dict(),
            progress=progress,
        )
        read = {name: dataset[name].values for name in dataset.data_vars}
        report = member_report(plan, read.__getitem__, f"flights in {target}", _uncontrolled(plan))
    notes = list(dict.fromkeys(plan.point.warnings))
    report = report.with_data(store=None if target is None else str(target), warnings=notes)
    if spread is not None:
        report = with_stability(report, plan, request.trim.condition, ProgressLine("draws"))
    shown = replace(request, output=replace(request.output, file=None))
    shown.show(report, figure=lambda: drawn_figure(plan), notes=notes)
    return 0 if is_enough(report.data["within_limits"], plan.members, plan.share) else 1


def _uncontrolled(plan: MonteCarlo) -> Mapping[str, np.ndarray] | None:
    """Return the results of the same flights without control beside those with a filter."""
    from hfa_flight.policies.filtered_policy import FilteredPolicy
    from hfa_flight.policies.given import policy_and_scenario
    from hfa_flight.samples.store import run_monte_carlo

    if not isinstance(plan.policy, FilteredPolicy):
        return None
    policy, scenario = policy_and_scenario(None, plan.point, plan.scenario)
    free = replace(plan, policy=policy, scenario=scenario)
    return run_monte_carlo(free, 1, ProgressLine("simulate without control"))
