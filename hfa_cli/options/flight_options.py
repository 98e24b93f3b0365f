"""Options of a flight: the policy that flies, and what happens: length, begin, signals, errors, actuators, air."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.actuators import ActuatorFault, Actuators
from controller.flight.envelope import Envelope, control_limits, flight_envelope
from controller.flight.gusts import Dryden, Gust, OneMinusCosine
from controller.flight.plants import UPDRAFT
from controller.flight.scenario import Scenario, Uncertainty, met_at
from controller.game.array_file import PlantNames
from controller.game.zero_sum import Game
from controller.policy import paper_flight
from controller.policy.signals import CommandedStates, CommandSteps, Harmonic, Signal
from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import OWN, in_unit, input_file, number, numbers, parsed, span, whole
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import DEFAULT_LAW, add_settings, law_settings, shown_learning
from hfa_cli.options.parser import add_named, add_value
from hfa_model.aircraft import HFA, Aircraft
from hfa_support.errors import BadInputError, refuse_unknown, said_of
from hfa_support.model import Model, record
from trim.linear.linear_model import LinearModel
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.flight.nonlinear_flight import NonlinearFlight
    from controller.policy.policies import FlownLaw
    from hfa_support.reporting.report import Report

#: Laws of a simulation: the exact gain, or a learned one that comes with certificates; or none.
LAWS = ("exact", "certified")
NONE = "none"
#: How help shows the values of options.
_COMMAND = "NAME=TIME:VALUE[,TIME:VALUE...]"
_WAVE = "NAME=CONSTANT[:AMPLITUDE:RAD/S]"
_GUST, _TURBULENCE = "LENGTH:PEAK[:BEGIN]", "SIGMA:SCALE"
_ACTUATORS, _FAULT = "LAG:RATE[:ORDER]", "EFFECTIVENESS:BANDWIDTH[:BEGIN]"
_TICK = 0.01
#: In place of NAME=...: what the paper simulates in Section 5 (`controller/policy/paper_flight.py`).
PAPER = "paper"
#: What flies in place of a law -> options that then would change nothing.
_IN_PLACE = {"controller": ("law", "set", "weights", "delta", "Q", "R"), "weights": ("law", "set", "delta", "Q")}


def add_aircraft(parser: argparse.ArgumentParser) -> None:
    """--aircraft, --dynamics, --parameters."""
    options.add_own(parser)
    options.add_aircraft(parser)


def aircraft_of(arguments: argparse.Namespace) -> Aircraft | Model:
    """The user's own aircraft, or the HFA that the options name."""
    return options.own_of(arguments) or options.aircraft_of(arguments)


def _model() -> Model:
    """Whose names and units options have."""
    return OWN.get() or HFA


# The policy.


def add_law(parser: argparse.ArgumentParser, *more: str) -> None:
    """--law, --set, --seed, --delta, --Q, --R."""
    add_value(parser, "--law", str, "NAME", f"{', '.join((*LAWS, *more))}; default {DEFAULT_LAW}")
    add_settings(parser)
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data and of what is random in flight; default 0")
    games.add_weights(parser)


def add_stored(parser: argparse.ArgumentParser) -> None:
    """--weights."""
    about = f"use this gain K, or the policy of the critic W or P, instead of a law ({' '.join(MATRIX_FILES)})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)


def add_commands(parser: argparse.ArgumentParser) -> None:
    """--controller, --command."""
    add_value(parser, "--controller", input_file(".npz"), "FILE", "fly this scheduled controller behind --actuators")
    about = (
        f"what shall be followed, s and degrees off trim: steps, or {_WAVE}, or `{PAPER}`; with --law {NONE} steps of"
    )
    add_named(parser, "--command", _command, _COMMAND, f"{about} inputs; repeatable", alone=PAPER)


def law_of(arguments: argparse.Namespace) -> str:
    """The law that the options name."""
    from controller.laws.certified import known_law

    law = DEFAULT_LAW if arguments.law is None else str(arguments.law)
    flown = hasattr(arguments, "controller") and hasattr(arguments, "command")
    return known_law(law, (*LAWS, NONE) if flown else LAWS)


def seed_of(arguments: argparse.Namespace) -> int:
    """The seed that the options name."""
    return 0 if arguments.seed is None else int(arguments.seed)


def check_policy(arguments: argparse.Namespace) -> None:
    """BadInputError for an unknown law, and for options that have no effect on the policy."""
    known, law = vars(arguments), law_of(arguments)
    learned = law not in ("exact", NONE)
    for name, others in _IN_PLACE.items():
        if known.get(name) is not None:
            learned, unused = False, tuple(other for other in others if other in known)
            options.refuse(arguments, unused, f"changes nothing beside --{name}; leave it out")
    if law == NONE:
        options.refuse(arguments, ("delta", "Q", "R"), f"belongs to a law; leave it out with --law {NONE}")
    if not learned:
        options.refuse(arguments, ("set",), f"belongs to a learning law; with --law {law} there is nothing to learn")
        random = "samples" in known or known.get("turbulence") is not None
        if arguments.seed is not None and not random:
            raise BadInputError("--seed belongs to a learning law or to --turbulence; here nothing is random")


def flown_law_of(arguments: argparse.Namespace, model: LinearModel) -> FlownLaw:
    """The gain that is used: of a file, exact, or learned on the linear model."""
    from controller.policy.learned_gain import learned_value
    from controller.policy.policies import gain_law
    from controller.riccati.gare import solve_game

    game, law = games.game_on(arguments, model), law_of(arguments)
    if getattr(arguments, "weights", None) is not None:
        return _stored_law(arguments, game, PlantNames(model.states, model.inputs, model.state_units))
    if law == "exact":
        return gain_law("exact", solve_game(game).K)
    return gain_law(law, learned_value(game, law, seed_of(arguments), shown_learning(), **law_settings(arguments)).K)


def _stored_law(arguments: argparse.Namespace, game: Game, plant: PlantNames) -> FlownLaw:
    """u = -K z of the file that the options name: its K, or that of its P or W with the game's B and R."""
    from controller.game.basis import basis
    from controller.game.critic_file import load_critic
    from controller.policy.policies import gain_law
    from verification.critic.candidate import from_gain, from_stored

    path, functions = arguments.weights, basis("quadratic", len(game.A))
    stored = load_critic(path, plant, functions)
    if stored.W is not None and stored.W.size != functions.size:
        raise BadInputError(
            f"{path}: there are {stored.W.size} weights; a simulation takes the {functions.size} of the quadratic basis"
        )
    with said_of(path):
        K = from_stored(game, stored, functions).K if stored.K is None else from_gain(game, stored.K).K
    return gain_law(f"{'weights' if stored.K is None else 'gain'} of {path}", K)


def policy_of(
    arguments: argparse.Namespace, aircraft: Aircraft | Model, point: OperatingPoint, scenario: Scenario
) -> tuple[FlownLaw, Scenario]:
    """What flies: --controller, no law, or a gain; and the scenario with the commands as reference."""
    from controller.design.scheduled_controller import load_controller
    from controller.policy.policies import open_loop
    from controller.policy.servo_policy import servo_law
    from trim.linear.linear_model import linearize

    given = arguments.command or {}
    steps = CommandSteps((), np.zeros(0), np.zeros((0, 0)))
    if isinstance(given, dict) and any(isinstance(each, list) for each in given.values()):
        waves = [name for name, each in given.items() if not isinstance(each, list)]
        if waves:
            raise BadInputError(f"--command {waves[0]} is no step, but others are; give {_COMMAND} for each")
        steps = _steps_of(given)
    elif given and (arguments.controller is not None or law_of(arguments) == NONE):
        raise BadInputError(f"--command with --controller or --law {NONE} takes steps; give {_COMMAND}")
    if arguments.controller is not None:
        if arguments.actuators is None:
            raise BadInputError("--controller flies behind actuators; add --actuators LAG:RATE")
        controller = load_controller(arguments.controller, aircraft.model)
        steps = CommandSteps(steps.names, steps.times, steps.values, *controller.command_filter)
        follow = CommandedStates(steps, point.model.linear)
        return servo_law(controller, steps, aircraft, point), replace(scenario, reference=follow)
    if law_of(arguments) == NONE:
        return open_loop(steps, tuple(point.model.inputs), scenario.tick, scenario.ticks), scenario
    if steps.names:
        for name in steps.names:
            refuse_unknown("a gain follows no command of", name, point.model.linear)
        scenario = replace(scenario, reference=CommandedStates(steps, point.model.linear, filtered=False))
    elif given:
        scenario = replace(scenario, reference=_signal_of("reference", given, point.model.linear))
    return flown_law_of(arguments, linearize(aircraft, point)), scenario


def _steps_of(given: dict[str, list[tuple[float, float]]]) -> CommandSteps:
    """The steps of --command on the times of all names."""
    times = sorted({time for steps in given.values() for time, _ in steps})
    values = np.zeros((len(times), len(given)))
    for column, steps in enumerate(given.values()):
        for time, value in steps:
            values[times.index(time) :, column] = value
    return CommandSteps(tuple(given), np.array(times), values)


def _command(name: str, text: str) -> list[tuple[float, float]] | tuple[float, ...]:
    """The type of --command: (time, value) pairs, increasing; or a constant or a wave."""
    if "," not in text and text.count(":") != 1 and name in _model().linear:
        return _constant_or_wave(_model().linear)(name, text)
    found = []
    for part in text.split(","):
        time, colon, value = part.partition(":")
        if not colon:
            raise argparse.ArgumentTypeError(f"is {text!r}; give {_COMMAND}")
        unit = _model().unit(name) if name in _model().signals else "1"
        found.append((number(time), in_unit(unit, value)))
    if found[0][0] < 0.0 or any(late <= early for (early, _), (late, _) in pairwise(found)):
        raise argparse.ArgumentTypeError(f"is {text!r}; the times must increase, from 0 on")
    return found


# What happens.


def add_scenario(parser: argparse.ArgumentParser, duration: str = "20", *, members: bool = False) -> None:
    """What happens in the flight besides a reference; everything is off by default.

    duration: what help calls it. members: --error, --noise and --turbulence are drawn for each member.
    """
    add_value(parser, "--duration", number, "S", f"default {duration}")
    add_value(parser, "--step", number, "S", "fixed step of the integration, default 0.001", default=0.001)
    about = "a state off trim at the start, degrees; or `paper`"
    add_named(parser, "--initial", _of(tuple(_model().states)), "NAME=VALUE", about, alone=PAPER)
    air = (*_model().linear, *_model().disturbances)
    _add_signal(parser, "--disturbance", "added to the rate of a state, or a disturbance of the model", air)
    add_actuators(parser)
    about = "actuators of the surfaces from BEGIN on: share of the command that arrives, bandwidth in rad/s"
    add_value(parser, "--fault", parsed(_fault), _FAULT, about)
    add_value(parser, "--delay", number, "S", "time by which every command of the policy comes late")
    about = "Dryden turbulence, ft/s and ft, from --seed"
    wind = _model().unit(UPDRAFT) if UPDRAFT in _model().disturbances else "ft/s"
    length = wind.removesuffix("/s")
    add_value(parser, "--turbulence", numbers(_TURBULENCE, 2, wind, length), _TURBULENCE, about)
    if members:
        about = "relative standard deviation of a parameter"
        add_named(parser, "--error", lambda _, text: number(text), "NAME=DEVIATION", about)
        about = "standard deviation of a sensor, degrees for angles"
        add_named(parser, "--noise", _of(_model().linear), "NAME=DEVIATION", about)
    else:
        about = "factor on a parameter of the simulated aircraft, unknown to the design"
        add_named(parser, "--error", lambda _, text: number(text), "NAME=FACTOR", about)
        _add_signal(parser, "--noise", "added to what a sensor says", _model().linear)
        about = "1-cosine updraft, ft, ft/s and s"
        add_value(parser, "--gust", numbers(_GUST, 2, length, wind, "s"), _GUST, about)
    add_envelope(parser)


def add_envelope(parser: argparse._ActionsContainer) -> None:
    """--envelope: between which values each state must stay."""
    about = "other limits of a state, absolute (alpha: through the air); repeatable"
    add_named(parser, "--envelope", span, "NAME=LOW:HIGH", about)


def scenario_of(arguments: argparse.Namespace, point: OperatingPoint, duration: float = 20.0) -> Scenario:
    """The scenario that the options name, about a trim; of members the random quantities of each.

    duration: unless given, s.
    """
    duration = duration if arguments.duration is None else arguments.duration
    model, disturbed = point.model, arguments.disturbance or {}
    air: dict[str, Signal] = {}
    if isinstance(disturbed, dict):
        winds = {name: value for name, value in disturbed.items() if name in model.disturbances}
        disturbed = {name: value for name, value in disturbed.items() if name not in winds}
        air = {name: _signal_of("", {name: value}, (name,)) for name, value in winds.items()}
    common = Scenario(
        duration=duration,
        step=arguments.step,
        tick=_tick_of(arguments, duration),
        initial=_initial_of(arguments.initial, model),
        disturbance=_signal_of("disturbance", disturbed, model.linear),
        actuators=actuators_of(arguments),
        delay=arguments.delay or 0.0,
        air=air,
    )
    if hasattr(arguments, "samples"):
        drawn = Uncertainty(arguments.error or {}, arguments.noise or {}, arguments.turbulence)
        return replace(common, uncertainty=drawn).on(model)
    noise = _signal_of("noise", arguments.noise or {}, model.linear)
    found = replace(common, noise=noise, errors=arguments.error or {}, gust=_gust(arguments, point, common))
    return found.on(model)


def _tick_of(arguments: argparse.Namespace, duration: float) -> float:
    """0.01 s, or the longest shorter tick of whole steps of which delay and duration are a whole number."""
    delay, step = arguments.delay or 0.0, arguments.step
    if not delay or step <= 0.0:
        return _TICK
    if not step <= delay < duration:
        raise BadInputError(f"--delay is {delay:g} s; give at least a step of {step:g} s and less than the duration")
    for steps in range(min(round(_TICK / step), round(delay / step)), 0, -1):
        tick = steps * step
        if all(abs(each / tick - round(each / tick)) < 1e-6 for each in (delay, duration)):
            return float(tick)
    raise BadInputError(f"--delay is {delay:g} s; make delay and duration a whole number of steps of {step:g} s")


def envelope_of(arguments: argparse.Namespace, aircraft: Aircraft | Model, point: OperatingPoint) -> Envelope:
    """The envelope about a trim, with the limits that the options name."""
    return flight_envelope(aircraft, point, arguments.envelope)


def _gust(arguments: argparse.Namespace, point: OperatingPoint, scenario: Scenario) -> Gust | None:
    if arguments.gust is not None and arguments.turbulence is not None:
        raise BadInputError("--gust and --turbulence do not go together; give one of them")
    if arguments.gust is not None:
        length, peak, begin = (*arguments.gust, 0.0)[:3]
        if not 0 <= begin < scenario.duration:
            raise BadInputError(f"--gust begins at {begin:g} s; the flight lasts from 0 to {scenario.duration:g} s")
        return OneMinusCosine(length, peak, met_at(point), begin)
    if arguments.turbulence is not None:
        intensity, scale = arguments.turbulence
        return Dryden(intensity, scale, met_at(point), scenario.tick, scenario.ticks, seed_of(arguments))
    return None


def _add_signal(parser: argparse._ActionsContainer, option: str, about: str, names: tuple[str, ...]) -> None:
    """An option of a signal: constants, and a sine for some of these names."""
    add_named(parser, option, _constant_or_wave(names), _WAVE, f"{about}; or `{PAPER}`", alone=PAPER)


def _refuse_paper(model: Model) -> None:
    if OWN.get() is not None:
        raise BadInputError(f"`{PAPER}` stands for signals of the HFA; name those of {model.name}")


def _initial_of(given: dict[str, float] | str | None, model: Model) -> np.ndarray:
    """What --initial says as a deviation from trim, (n,)."""
    start = dict.fromkeys(model.states, 0.0)
    if isinstance(given, str):
        _refuse_paper(model)
        given = dict(zip(model.linear, paper_flight.INITIAL.tolist(), strict=True))
    return np.array(list((start | (given or {})).values()))


def _signal_of(what: str, given: dict[str, tuple[float, ...]] | str, names: tuple[str, ...]) -> Signal:
    """What the option of a signal says of these names: constants, and a sine with its frequency for some."""
    if isinstance(given, str):
        _refuse_paper(_model())
        paper = {"reference": paper_flight.REFERENCE, "disturbance": paper_flight.DISTURBANCE}
        return paper.get(what, paper_flight.NOISE)
    constant, harmonics = np.zeros(len(names)), []
    for name, (value, *wave) in given.items():
        index = names.index(name)
        constant[index] = value
        if wave:
            sine = np.zeros(len(names))
            sine[index], frequency = wave
            harmonics.append(Harmonic(frequency, sine, np.zeros(len(sine))))
    return Signal(constant, np.zeros(len(names)), tuple(harmonics))


def _of(names: tuple[str, ...]) -> Callable[[str, str], float]:
    """The type of one value of one of these names."""

    def kind(name: str, text: str) -> float:
        if name not in names:
            raise argparse.ArgumentTypeError(f"is not among the states {', '.join(names)}")
        return in_unit(_model().unit(name), text)

    return kind


def _constant_or_wave(names: tuple[str, ...]) -> Callable[[str, str], tuple[float, ...]]:
    """The type of a signal of these names: (constant,) or (constant, amplitude, rad/s)."""
    value = _of(names)

    def kind(name: str, text: str) -> tuple[float, ...]:
        parts = text.split(":")
        values = tuple(value(name, part) for part in parts[:2])
        if len(parts) not in (1, 3):
            raise argparse.ArgumentTypeError(f"is {text!r}; give {name}=CONSTANT or {name}=CONSTANT:AMPLITUDE:RAD/S")
        if len(parts) == 1:
            return values
        frequency = number(parts[2])
        if frequency <= 0:
            raise argparse.ArgumentTypeError(f"frequency is {frequency:g} rad/s; it must be positive")
        return (*values, frequency)

    return kind


def add_actuators(parser: argparse._ActionsContainer) -> None:
    """--actuators."""
    about = "actuators, s and deg/s, within the trim's control limits; order 1 (default) or 2"
    add_value(parser, "--actuators", numbers(_ACTUATORS, 2, "s", "deg/s", "1"), _ACTUATORS, about)


def actuators_of(arguments: argparse.Namespace) -> Actuators | None:
    """The actuators that the options name, None without them: of the surfaces, inputs in rad or deg, with that rate."""
    fault = getattr(arguments, "fault", None)
    if arguments.actuators is None:
        if fault is not None:
            raise BadInputError("--fault belongs to --actuators; give both")
        return None
    lag, degrees_per_second, *order = arguments.actuators
    if degrees_per_second <= 0:
        raise BadInputError(f"--actuators rate is {degrees_per_second:g} deg/s; it must be positive")
    model = _model()
    rates = {"rad": math.radians(degrees_per_second), "deg": degrees_per_second}
    surfaces = tuple(name for name, each in model.inputs.items() if each.unit in rates)
    values: Any = record(tuple(model.inputs))
    lowest, highest = (values(*ends.tolist()) for ends in control_limits(model))
    return Actuators(
        values(*[lag] * len(model.inputs)),
        lowest,
        highest,
        values(*(rates.get(each.unit, math.inf) for each in model.inputs.values())),
        order=int(order[0]) if order else 1,
        faults=() if fault is None else (replace(fault, inputs=surfaces),),
    )


def _fault(text: str) -> ActuatorFault:
    """The type of --fault."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"is {text!r}; give {_FAULT}")
    effectiveness, bandwidth, *begin = map(number, parts)
    return ActuatorFault(begin[0] if begin else 0.0, effectiveness, bandwidth)


def tell_flight(
    result: NonlinearFlight, report: Report, points: list[OperatingPoint], arguments: argparse.Namespace
) -> int:
    """Draw, print and write a flight; the exit code, 1 when it did not stay within its limits."""
    from hfa_cli.output import draw, tell
    from verification.flights.flight_figures import flight_figure

    draw(arguments.picture, lambda: flight_figure(result, report.title))
    tell(report, points, arguments, arguments.output, result.history())
    return 0 if result.within_limits else 1
