"""Command-line options of a flight: policy and scenario."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hfa.inherited import LearningOptions, ReadingOptions, TrimOptions, WeightOptions
from hfa.learning import DEFAULT_LAW, law_option, setting_option
from hfa.options.argument_types import input_file, number, one_of, positive, quantity, span
from hfa.options.critics import READING_SETTINGS, critic_path
from hfa.options.part import OfModel, option
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.signals import record
from hfa_aircraft.waveform import Waveform
from hfa_flight.actuators import ActuatorBank, ActuatorFault
from hfa_flight.air.gust_equations import in_gusts
from hfa_flight.air.gusts import Gust, OneMinusCosine
from hfa_flight.air.names import UPDRAFT, gust_speed
from hfa_flight.air.turbulence import LEVELS, SPECTRA, Turbulence
from hfa_flight.closed_loop import ClosedLoop, NonlinearPlant
from hfa_flight.envelope import control_limits, flight_envelope
from hfa_flight.flight import lengthened
from hfa_flight.own_steps import JSBSIM, METHODS, RUNGE_KUTTA
from hfa_flight.scenario import Scenario, Uncertainty, with_errors
from hfa_flight.signals import CommandedStates, CommandSteps
from hfa_support.errors import BadInputError, NoSolutionError, choice_of, refuse_unknown, warn
from hfa_support.files import MATRIX_FILES
from trim.linear.linear_model import LinearModel
from trim.point.linearize import linearize
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from hfa_flight.policies.policy import FunctionPolicy, GainPolicy, Policy

#: Name of the law without a policy. Commands are then steps of inputs.
NONE = "none"
#: Forms of values in the help of options.
_COMMAND = "NAME=TIME:VALUE[,TIME:VALUE...]"
_GUST = "LENGTH:PEAK[:BEGIN]"
_TURBULENCE = "LEVEL[:ALTITUDE[:SPAN]]"
_OWN = "own:SIGMA:SCALE[:SPAN]"
_ACTUATORS = "LAG:RATE[:ORDER]"
_FAULT = "EFFECTIVENESS:BANDWIDTH[:BEGIN]"
#: Option that replaces the law -> options that have no effect with it.
_IN_PLACE = {
    "controller": ("law", "set", "weights", "delta", "Q", "R"),
    "weights": ("law", "delta", "Q"),
    "policy": ("law", "set", "weights", "controller", "delta", "Q", "R", "delay", "command"),
}


def among(names: tuple[str, ...], model: Model, name: str, text: str) -> float:
    """Return the number typed for a variable, in the model's units.

    names: permitted variables
    name: the typed variable
    text: the typed number

    Raises BadInputError if the variable is not permitted.
    """
    if name not in names:
        raise BadInputError(f"is unknown; {choice_of(name, names)}")
    return quantity(model, name, text)


def _number(_: str, text: str) -> float:
    return number(text)


def _command(model: Model, name: str, text: str) -> list[tuple[float, float]]:
    """Return the steps of a command: pairs (time in s, value), with times increasing from 0 on.

    name: name of the commanded variable
    text: typed text "TIME:VALUE,TIME:VALUE", with values in the units of the command line

    Raises BadInputError if the text has another form.
    """
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise BadInputError(f"is {text!r}; give {_COMMAND}")
    steps = [(number(time), quantity(model, name, value)) for time, value in pairs]
    times = [time for time, _ in steps]
    if times[0] < 0.0 or any(later <= earlier for earlier, later in pairwise(times)):
        raise BadInputError(f"is {text!r}; give increasing times of at least 0 s")
    return steps


def fraction(text: str) -> float:
    """Return the positive number that a text such as 0.01 or 1/120 represents."""
    above, slash, below = text.partition("/")
    value = positive(above)
    return value / positive(below) if slash else value


def weights_option() -> Any:
    """Return the option `--weights` as a dataclass field."""
    about = "file with a gain K, a critic (W or P) or a network; replaces --law"
    return option(about, "FILE", critic_path)


@dataclass(frozen=True, kw_only=True, eq=False)
class LawOptions(LearningOptions, WeightOptions, ReadingOptions):
    """Options of the policy: a law with its game, or a file with a gain or a critic."""

    law: str = law_option("exact")
    set: Mapping[str, Any] = setting_option(
        "setting of the learning law, such as predefined_time=2, or of a critic: scale=a,b,... "
        "(network: factor on each state), activation=HIDDEN[,OUTPUT] (state dict)",
        READING_SETTINGS,
    )
    weights: Path | None = None
    controller: Path | None = None
    policy: Path | None = None
    turbulence: Turbulence | None = None
    samples: int | None = None
    draws: int | None = None

    @property
    def members(self) -> int | None:
        """Number of flights with random differences, or None for a single flight."""
        return self.samples if self.draws is None else self.draws

    @property
    def prices(self) -> Sequence[str]:
        """Options that are weights of the flight's cost but not of the policy; by default none."""
        return ()

    def check_policy(self) -> None:
        """Raise BadInputError for an option that has no effect with the chosen policy."""
        instead = [name for name in _IN_PLACE if getattr(self, name) is not None]
        for name in instead:
            without_effect = [each for each in _IN_PLACE[name] if each not in self.prices]
            self.refuse(without_effect, f"has no effect with --{name}; remove this option")
        if self.law == NONE:
            of_law = [name for name in ("delta", "Q", "R") if name not in self.prices]
            self.refuse(of_law, f"applies only to a law; remove this option or --law {NONE}")
        reads = {*READING_SETTINGS} & {*self.set}
        if reads and self.weights is None:
            raise BadInputError(
                f"--set {min(reads)} applies only to a network; remove this setting, or give a "
                "network with --weights"
            )
        if self.law == DEFAULT_LAW and not instead:
            return
        if {*self.set} - reads:
            given = f"--{instead[0]}" if instead else f"--law {self.law}"
            self.refuse(
                ("set",), f"applies only to a learning law, not to {given}; remove this option"
            )
        if self.members is None and self.turbulence is None:
            self.refuse(
                ("seed",), "applies only to a learning law or --turbulence; remove this option"
            )

    def policy_about(self, linear: LinearModel) -> GainPolicy | FunctionPolicy:
        """Return the policy about a trim that the options specify.

        The policy is read from a file, computed exactly, or learned on the linear model. A
        nonlinear policy, such as a network, is saturated at the control limits of the model. Raises
        NoSolutionError if learning does not converge.
        """
        from controller.critic.critic_file import critic_in
        from controller.riccati.gare import unconfirmed_solution
        from hfa_flight.policies.policy import GainPolicy, function_policy

        game = self.game_on(linear)
        path = self.weights
        if path is None and self.law == "exact":
            return GainPolicy("exact", unconfirmed_solution(game).K)
        if path is None:
            run = self.learned(game)
            if not run.settled:
                raise NoSolutionError(
                    f"law '{self.law}' learned no policy: {run.outcome}; choose another law or "
                    "model"
                )
            return GainPolicy(self.law, run.K)
        critic = critic_in(path, game, self.reading())
        if not critic.linear:
            return function_policy(f"critic of {path}", critic.policy, linear.point)
        kind = "gain" if critic.feedback is None else "weights"
        return GainPolicy(f"{kind} of {path}", critic.K)


def noted_linear_model(model: Model, point: OperatingPoint) -> LinearModel:
    """Return the linear model at a trim, and issue the notes on kinks as warnings."""
    linear = linearize(model, point)
    for note in linear.kinks:
        warn(note)
    return linear


def numbers(
    form: str, count: int, otherwise: tuple[float, ...] = ()
) -> Callable[[str], tuple[float, ...]]:
    """Return a function that converts a text such as "1:2:3" to a tuple of `count` numbers.

    The function raises BadInputError for a wrong number of parts, or for a part that is not a
    number.

    form: description of the text for error messages
    otherwise: default values of the last numbers. The text may omit these numbers
    """

    def convert(text: str) -> tuple[float, ...]:
        parts = text.split(":")
        least = count - len(otherwise)
        if not least <= len(parts) <= count:
            raise BadInputError(f"is {text!r}; give {form}")
        return (*(number(part) for part in parts), *otherwise[len(parts) - least :])

    return convert


def deployment_option() -> Any:
    """Return the option `--policy` as a dataclass field."""
    about = "policy from a deployment file, sampled and held"
    return option(about, "DEPLOYMENT.toml", input_file(".toml"))


def controller_option() -> Any:
    """Return the option `--controller` as a dataclass field."""
    about = "file with a controller from `hfa design`, or with scheduled gains"
    return option(about, "FILE", input_file(*MATRIX_FILES))


def actuators_option() -> Any:
    """Return the option `--actuators` as a dataclass field."""
    about = "add actuators with lag (s), rate limit (deg/s) and order 1 (default) or 2"
    kind = numbers(_ACTUATORS, 3, otherwise=(1.0,))
    return option(about, _ACTUATORS, kind)


def _about_gust(model: Model) -> str:
    length = _length_of(model)
    return f"1-cosine updraft: length ({length}), peak ({length}/s), begin (s, default 0)"


def _about_turbulence(model: Model) -> str:
    length = _length_of(model)
    return (
        f"turbulence of MIL-F-8785C at ALTITUDE, {length}: {', '.join(LEVELS)}; a wing SPAN,"
        f" {length}, adds p, q, r; karman-LEVEL has spectra of von Karman; {_OWN} has intensity,"
        f" {length}/s, and scale, {length}; random by --seed"
    )


def _length_of(model: Model) -> str:
    """Return the unit of length of the gust velocities of a model, for options such as --gust."""
    gusty = in_gusts(model)
    return gusty.unit(UPDRAFT).removesuffix("/s") if UPDRAFT in gusty.disturbances else "ft"


def _turbulence(text: str) -> Turbulence:
    """Return the turbulence that a typed text specifies.

    The text is one of:

    - a level, optionally with altitude and span
    - "own" with intensity and scale, optionally with span

    Raises BadInputError if the text has another form.
    """
    word, *typed = text.split(":")
    spectrum, _, level = word.rpartition("-")
    least, most = (2, 3) if level == "own" else (0, 2)
    known = level in (*LEVELS, "own") and spectrum in ("", *SPECTRA)
    if not known or not least <= len(typed) <= most:
        raise BadInputError(f"is {text!r}; give {_TURBULENCE} with {', '.join(LEVELS)}, or {_OWN}")
    spectrum = spectrum or SPECTRA[0]
    if level == "own":
        intensity, scale, *spans = map(positive, typed)
        return Turbulence((intensity, scale), None, spans[0] if spans else None, spectrum)
    altitude, span, *_ = [*(positive(size) if size else None for size in typed), None, None]
    return Turbulence(level, altitude, span, spectrum)


def linear_state(model: Model, name: str, text: str) -> float:
    """Return the number typed for a state of the linear model, in the model's units.

    name: the typed state
    text: the typed number

    Raises BadInputError if the name is not a state of the linear model.
    """
    return among(model.linear, model, name, text)


def turbulence_option() -> Any:
    """Return the option `--turbulence` as a dataclass field."""
    return option(_about_turbulence, _TURBULENCE, _turbulence, rare=True)


def at_held_altitude(typed: Turbulence | None, hold: Mapping[str, Any]) -> Turbulence | None:
    """Return the typed turbulence, or None if none was typed.

    A level without an altitude receives the altitude of --hold.

    hold: values of --hold by name
    """
    if typed is None or typed.level not in LEVELS or typed.altitude is not None:
        return typed
    return replace(typed, altitude=hold.get("altitude"))


def noise_option(about: str) -> Any:
    """Return the option `--noise` as a dataclass field.

    The value of the field maps a state to the standard deviation of its sensor noise.

    about: help text
    """
    return option(about, "NAME=VALUE", OfModel(linear_state), named=True, rare=True)


def gust_option() -> Any:
    """Return the option `--gust` as a dataclass field."""
    return option(_about_gust, _GUST, numbers(_GUST, 3, otherwise=(0.0,)))


def gust_at(
    typed: tuple[float, ...] | None, point: OperatingPoint, duration: float
) -> OneMinusCosine | None:
    """Return the gust of the option --gust at the speed of a trim, or None without the option.

    typed: length, peak and start of the gust, in the units of the model and s
    duration: s

    Raises BadInputError if the gust begins outside the duration, its length is not positive, or the
    model has no state or output `speed`.
    """
    if typed is None:
        return None
    length, peak, begin = typed
    if not 0 <= begin < duration:
        raise BadInputError(
            f"--gust begins at {begin:g} s, outside the flight; give BEGIN from 0 to less than "
            f"{duration:g} s"
        )
    return OneMinusCosine(length, peak, gust_speed(point), begin)


def _state(model: Model, name: str, text: str) -> float:
    return among(tuple(model.states), model, name, text)


def _disturbed(model: Model, name: str, text: str) -> float:
    return among((*model.linear, *model.disturbances), model, name, text)


@dataclass(frozen=True, kw_only=True, eq=False)
class ScenarioOptions(LawOptions, TrimOptions):
    """Options of the scenario of a flight, except for commands.

    By default, nothing disturbs the flight.
    """

    duration: float | None = option(
        "duration, s; default 20, or more if unstable", "S", number, default=20.0
    )
    initial: Mapping[str, float] = option(
        "initial deviation of a state from the trim, degrees for angles; repeatable",
        "NAME=VALUE",
        OfModel(_state),
        named=True,
    )
    disturbance: Mapping[str, float] = option(
        "constant added to the derivative of a state, or value of a disturbance of the model; "
        "repeatable",
        "NAME=VALUE",
        OfModel(_disturbed),
        named=True,
        rare=True,
    )
    actuators: tuple[float, ...] | None = actuators_option()
    fault: tuple[float, ...] | None = option(
        "fault of all actuators: factor on the command, bandwidth (rad/s), start time (s)",
        _FAULT,
        numbers(_FAULT, 3, otherwise=(0.0,)),
        rare=True,
    )
    delay: float = option(
        "delay of every command of the policy, s; default 0",
        "S",
        number,
        default=0.0,
        rare=True,
    )
    turbulence: Turbulence | None = turbulence_option()
    error: Mapping[str, float] = option(
        "factor on a parameter of the simulated aircraft only; with --samples, relative "
        "standard deviation of the parameter; repeatable",
        "NAME=NUMBER",
        _number,
        named=True,
        rare=True,
    )
    noise: Mapping[str, float] = noise_option(
        "constant error of a measured state, degrees for angles; with --samples, standard "
        "deviation of the error; repeatable"
    )
    gust: tuple[float, ...] | None = gust_option()
    envelope: Mapping[str, tuple[float, float]] = option(
        "limits of a state that replace its default envelope, degrees for angles (alpha is "
        "relative to the air); repeatable",
        "NAME=LOW:HIGH",
        OfModel(span),
        named=True,
        rare=True,
    )

    def scenario(self, point: OperatingPoint) -> Scenario:
        """Return the scenario that the options specify for a trim.

        For several members, the scenario includes random quantities that are not drawn yet. The
        tick is the longest whole number of ms that divides both 10 ms and the delay.

        Raises BadInputError if the delay is out of range, or if both --gust and --turbulence are
        given.
        """
        duration = self.duration
        delay = self.delay
        model = point.model
        assert duration is not None
        if delay and not 0.0 < delay < duration:
            raise BadInputError(
                f"--delay is {delay:g} s; give a delay from 0 to less than {duration:g} s"
            )
        names = model.linear
        disturbed = self.disturbance
        common = Scenario(
            duration=duration,
            tick=math.gcd(10, round(1000.0 * delay)) / 1000.0,
            initial=np.array([self.initial.get(name, 0.0) for name in model.states]),
            disturbance=_constant([disturbed.get(name, 0.0) for name in names]),
            actuators=actuators_of(model, self.actuators, self.fault),
            delay=delay,
            air={
                name: _constant([value]) for name, value in disturbed.items() if name not in names
            },
        )
        if self.gust is not None and self.turbulence is not None:
            raise BadInputError("--gust and --turbulence cannot be combined; remove one of the two")
        gust = self._gust(point, common)
        if self.members is not None:
            turbulence = at_held_altitude(self.turbulence, self.hold)
            uncertainty = Uncertainty(self.error, self.noise, turbulence)
            return replace(common, uncertainty=uncertainty, gust=gust).on(model)
        noise = _constant([self.noise.get(name, 0.0) for name in names])
        return replace(common, noise=noise, errors=self.error, gust=gust).on(model)

    def _gust(self, point: OperatingPoint, happens: Scenario) -> Gust | None:
        """Return the gust of --gust or the turbulence of --turbulence, or None.

        With several members, the turbulence is drawn later and is not returned.
        """
        if self.gust is not None:
            return gust_at(self.gust, point, happens.duration)
        if self.turbulence is not None and self.members is None:
            turbulence = at_held_altitude(self.turbulence, self.hold)
            assert turbulence is not None
            return turbulence.air(point, happens.tick, happens.ticks, self.seed)
        return None


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightOptions(ScenarioOptions):
    """Options of a flight from a trim."""

    law: str = law_option(NONE, "exact")
    weights: Path | None = weights_option()
    controller: Path | None = controller_option()
    policy: Path | None = deployment_option()
    command: Mapping[str, list[tuple[float, float]]] = option(
        f"step commands for a state, or with --law {NONE} for an input: time, s, and deviation "
        "from the trim; repeatable",
        _COMMAND,
        OfModel(_command),
        named=True,
    )

    method: str = option(
        f"integration: {RUNGE_KUTTA} (default), or {JSBSIM} (JSBSim's own steps; JSBSim aircraft "
        "only)",
        "NAME",
        one_of(*METHODS),
        default=RUNGE_KUTTA,
        rare=True,
    )
    frame: float | None = option(
        f"step of --method {JSBSIM}, s; default 1/120",
        "S",
        fraction,
        names="--step",
        rare=True,
    )

    @property
    def prices(self) -> Sequence[str]:
        """Options that are weights of the flight's cost: --Q and --R for a single flight.

        There are none for several flights.
        """
        return ("Q", "R") if self.members is None else ()

    def flight(self) -> PlannedFlight:
        """Return the flight to be simulated, as specified by the options.

        Raises BadInputError if the options contradict each other.
        """
        from hfa_flight.policies.policy import open_loop

        self.check_policy()
        model = self.flown_aircraft()
        point = self.operating_point(model)
        scenario = self.scenario(point)
        steps = _steps_of(self.command)
        reference: Any = None
        if self.policy is not None:
            from hfa_flight.policies.deployment.policy import flown_deployment, sampled_scenario

            deployed = flown_deployment(self.policy, point)
            scenario = sampled_scenario(deployed, scenario, point)
            policy: Policy = deployed
        elif self.controller is not None:
            policy, reference = self._controller_policy(model, point, steps)
        elif self.law == NONE:
            policy = open_loop(steps, tuple(model.inputs), scenario.tick, scenario.ticks)
        else:
            for name in steps.names:
                refuse_unknown("a gain cannot follow a command of", name, model.linear)
            if steps.names:
                reference = CommandedStates(steps, model.linear, filtered=False)
            policy = self.policy_about(noted_linear_model(model, point))
        if reference is not None:
            scenario = replace(scenario, reference=reference)
        return PlannedFlight(
            model, point, policy, scenario, flight_envelope(model, point, self.envelope)
        )

    def _controller_policy(
        self, model: Model, point: OperatingPoint, steps: CommandSteps
    ) -> tuple[Policy, Any]:
        """Return the policy of --controller and the reference of the flight.

        steps: commands of --command

        Raises BadInputError if --actuators is missing for a controller of `hfa design`.
        """
        from controller.schedule.gain_schedule import GainSchedule
        from controller.schedule.scheduled_controller import load_controller_or_gains
        from hfa_flight.policies.controller import servo_policy
        from hfa_flight.policies.scheduled_gains import scheduled_gains

        assert self.controller is not None
        controller = load_controller_or_gains(self.controller, model)
        if isinstance(controller, GainSchedule):
            name = f"gains of {self.controller}"
            condition = self.common_condition.at
            scheduled = scheduled_gains(name, controller, point, steps, condition)
            return scheduled, scheduled.path
        if self.actuators is None:
            raise BadInputError("--controller requires actuators; add --actuators LAG:RATE")
        steps = CommandSteps(steps.names, steps.times, steps.values, *controller.command_filter)
        policy = servo_policy(controller, steps, model, point)
        return policy, CommandedStates(steps, model.linear)


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


def _steps_of(given: Mapping[str, list[tuple[float, float]]]) -> CommandSteps:
    """Return the commands of --command as one table of steps.

    The times are the union of the times of all commanded variables.

    given: commanded variable -> pairs (time in s, value)
    """
    times = sorted({time for steps in given.values() for time, _ in steps})
    values = np.zeros((len(times), len(given)))
    for column, steps in enumerate(given.values()):
        for time, value in steps:
            values[times.index(time) :, column] = value
    return CommandSteps(tuple(given), np.array(times), values)


def _constant(values: list[float]) -> Waveform:
    return Waveform(np.array(values), np.zeros(len(values)))


def actuators_of(
    model: Model, typed: tuple[float, ...] | None, fault: tuple[float, ...] | None = None
) -> ActuatorBank | None:
    """Return the actuators that --actuators and --fault specify, or None without --actuators.

    Rate limit and fault apply to the surfaces. These are the inputs in rad or deg.

    typed: lag in s, rate limit in deg/s, order
    fault: factor on the command, bandwidth in rad/s, start in s

    Raises BadInputError if --fault is given alone or a number is out of range.
    """
    if typed is None:
        if fault is not None:
            raise BadInputError("--fault requires actuators; add --actuators LAG:RATE")
        return None
    lag, degrees_per_second, order = typed
    if degrees_per_second <= 0:
        raise BadInputError(
            f"the rate limit of --actuators is {degrees_per_second:g} deg/s; give a positive "
            "rate limit"
        )
    rates = {"rad": math.radians(degrees_per_second), "deg": degrees_per_second}
    inputs = model.inputs
    faults = []
    if fault is not None:
        effectiveness, bandwidth, begin = fault
        surfaces = tuple(name for name, signal in inputs.items() if signal.unit in rates)
        faults.append(ActuatorFault(begin, effectiveness, bandwidth, inputs=surfaces))
    values: Any = record(tuple(inputs))
    limits = control_limits(model)
    lowest = values(*limits.lowest.tolist())
    highest = values(*limits.highest.tolist())
    fastest = values(*(rates.get(signal.unit, math.inf) for signal in inputs.values()))
    lags = values(*[lag] * len(inputs))
    return ActuatorBank(lags, lowest, highest, fastest, order=int(order), faults=tuple(faults))
