"""Options of a flight: the policy that flies, and what happens: length, begin, signals, errors, actuators, air."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from controller.flight.actuators import ActuatorFault, Actuators
from controller.flight.envelope import Envelope, flight_envelope
from controller.flight.gusts import Dryden, Gust, OneMinusCosine
from controller.flight.scenario import Scenario, Uncertainty
from controller.game.array_file import PlantNames
from controller.game.zero_sum import Game, published_game
from controller.policy import paper_flight
from controller.policy.signals import Harmonic, Signal
from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import input_file, number, numbers, parsed, quantity, span, whole
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import DEFAULT_LAW, add_settings, law_settings, shown_learning
from hfa_cli.options.parser import add_named, add_value
from hfa_model.aircraft import Aircraft
from hfa_model.outputs import OUTPUTS
from hfa_model.vectors import LINEAR_ROWS, LINEAR_STATES, STATES, Input
from hfa_support.errors import BadInputError, refuse_unknown, said_of
from hfa_support.reporting.unit_system import typed
from trim.linear.linear_model import LinearModel
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.policy.policies import FlownLaw
    from controller.policy.signals import CommandSteps

#: Laws of a simulation: the exact gain, or a learned one that comes with certificates.
LAWS = ("exact", "certified", "irl")
#: How help shows the values of options.
_STEPS = "NAME=TIME:VALUE[,TIME:VALUE...]"
_GUST, _TURBULENCE = "LENGTH:PEAK[:BEGIN]", "SIGMA:SCALE"
_ACTUATORS, _FAULT = "LAG:RATE[:ORDER]", "EFFECTIVENESS:BANDWIDTH[:BEGIN]"
_TICK = 0.01
#: In place of NAME=...: what the paper simulates in Section 5 (`controller/policy/paper_flight.py`).
PAPER = "paper"
#: What flies in place of a law -> options that then would change nothing.
_IN_PLACE = {
    "controller": ("law", "set", "reference", "weights", "delta", "Q", "R"),
    "weights": ("law", "set", "delta", "Q"),
}

# The policy.


def add_law(parser: argparse.ArgumentParser) -> None:
    """--law, --set, --seed, --delta, --Q, --R."""
    add_value(parser, "--law", str, "NAME", f"{', '.join(LAWS)}; default {DEFAULT_LAW}")
    add_settings(parser)
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data and of what is random in flight; default 0")
    games.add_weights(parser)


def add_stored(parser: argparse.ArgumentParser) -> None:
    """--weights."""
    about = f"use this gain K, or the policy of the critic W or P, instead of a law ({' '.join(MATRIX_FILES)})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)


def add_controller(parser: argparse.ArgumentParser) -> None:
    """--controller, --command."""
    group = parser.add_argument_group("a controller instead of a law")
    about = "fly this scheduled controller (.npz) behind --actuators"
    add_value(group, "--controller", input_file(".npz"), "FILE", about)
    about = "steps off trim, s and degrees, through the command filter; repeatable"
    add_named(group, "--command", _steps, _STEPS, about)


def law_of(arguments: argparse.Namespace) -> str:
    """The law that the options name, one of `LAWS`."""
    law = DEFAULT_LAW if arguments.law is None else str(arguments.law)
    refuse_unknown("unknown law", law, LAWS)
    return law


def seed_of(arguments: argparse.Namespace) -> int:
    """The seed that the options name."""
    return 0 if arguments.seed is None else int(arguments.seed)


def check_policy(arguments: argparse.Namespace) -> None:
    """BadInputError for an unknown law, and for options that have no effect on the policy."""
    known, learned = vars(arguments), law_of(arguments) != "exact"
    for name, others in _IN_PLACE.items():
        if known.get(name) is not None:
            learned, unused = False, tuple(other for other in others if other in known)
            options.refuse(arguments, unused, f"changes nothing beside --{name}; leave it out")
    if not learned:
        options.refuse(arguments, ("set",), "belongs to a learning law; with --law exact there is nothing to learn")
        random = "members" in known or known.get("turbulence") is not None
        if arguments.seed is not None and not random:
            raise BadInputError("--seed belongs to a learning law or to --turbulence; here nothing is random")


def flown_law_of(arguments: argparse.Namespace, model: LinearModel) -> FlownLaw:
    """The gain that is used: exact, or learned on the linear model and frozen."""
    from controller.policy.learned_gain import learned_value
    from controller.policy.policies import gain_law
    from controller.riccati.gare import solve_game

    game, law = published_game(model.A, model.B, **games.weights_of(arguments)), law_of(arguments)
    if getattr(arguments, "weights", None) is not None:
        return _stored_law(arguments, game, PlantNames(model.states, model.inputs, model.state_units))
    if law == "exact":
        return gain_law("exact", solve_game(game).K)
    learned = learned_value(game, law, seed_of(arguments), shown_learning(), **law_settings(arguments))
    return gain_law(law, learned.K)


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


def controlled(
    arguments: argparse.Namespace, aircraft: Aircraft, point: OperatingPoint, scenario: Scenario
) -> tuple[FlownLaw | None, Scenario]:
    """The law of --controller, None without one, and the scenario with its commands as reference."""
    from controller.design.scheduled_controller import load_controller
    from controller.policy.servo_policy import servo_law
    from controller.policy.signals import CommandedStates

    if arguments.controller is None:
        if arguments.command:
            raise BadInputError("--command belongs to --controller; give both")
        return None, scenario
    if arguments.actuators is None:
        raise BadInputError("--controller flies behind actuators; add --actuators LAG:RATE")
    controller = load_controller(arguments.controller)
    commands = _commands_of(arguments, controller.command_filter)
    return servo_law(controller, commands, aircraft, point), replace(scenario, reference=CommandedStates(commands))


def _commands_of(arguments: argparse.Namespace, command_filter: tuple[float, ...]) -> CommandSteps:
    """What --command says, on the times of all names."""
    from controller.policy.signals import CommandSteps

    given: dict[str, list[tuple[float, float]]] = arguments.command or {}
    times = sorted({time for steps in given.values() for time, _ in steps})
    values = np.zeros((len(times), len(given)))
    for column, steps in enumerate(given.values()):
        for time, value in steps:
            values[times.index(time) :, column] = value
    return CommandSteps(tuple(given), np.array(times), values, *command_filter)


def _steps(name: str, text: str) -> list[tuple[float, float]]:
    """The type of --command: (time, value) pairs, increasing."""
    found = []
    for part in text.split(","):
        time, colon, value = part.partition(":")
        if not colon:
            raise argparse.ArgumentTypeError(f"is {text!r}; give {_STEPS}")
        unit = OUTPUTS[name].unit if name in OUTPUTS else "1"
        found.append((number(time), quantity(name, value) if name in STATES else typed(number(value), unit)))
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
    add_named(parser, "--initial", _initial, "NAME=VALUE", about, alone=PAPER)
    add_signal(parser, "--disturbance", "added to the rate of a state")
    add_actuators(parser)
    about = "actuators of the surfaces from BEGIN on: share of the command that arrives, bandwidth in rad/s"
    add_value(parser, "--fault", parsed(_fault), _FAULT, about)
    about = "Dryden turbulence, ft/s and ft, from --seed"
    add_value(parser, "--turbulence", numbers(_TURBULENCE, 2, "ft/s", "ft"), _TURBULENCE, about)
    if members:
        about = "relative standard deviation of a parameter"
        add_named(parser, "--error", lambda _, text: number(text), "NAME=DEVIATION", about)
        about = "standard deviation of a sensor, degrees for angles"
        add_named(parser, "--noise", quantity, "NAME=DEVIATION", about)
    else:
        about = "factor on a parameter of the simulated aircraft, unknown to the design"
        add_named(parser, "--error", lambda _, text: number(text), "NAME=FACTOR", about)
        add_signal(parser, "--noise", "added to what a sensor says")
        about = "1-cosine updraft, ft, ft/s and s"
        add_value(parser, "--gust", numbers(_GUST, 2, "ft", "ft/s", "s"), _GUST, about)
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
    common = Scenario(
        duration=duration,
        step=arguments.step,
        tick=_TICK,
        initial=_initial_of(arguments.initial),
        reference=_signal_of("reference", getattr(arguments, "reference", None)),
        disturbance=_signal_of("disturbance", arguments.disturbance),
        actuators=actuators_of(arguments),
    )
    if hasattr(arguments, "members"):
        drawn = Uncertainty(arguments.error or {}, arguments.noise or {}, arguments.turbulence)
        return replace(common, uncertainty=drawn)
    noise = _signal_of("noise", arguments.noise)
    return replace(common, noise=noise, errors=arguments.error or {}, gust=_gust(arguments, point, duration))


def envelope_of(arguments: argparse.Namespace, aircraft: Aircraft, point: OperatingPoint) -> Envelope:
    """The envelope about a trim, with the limits that the options name."""
    return flight_envelope(aircraft.parameters, point, arguments.envelope)


def _gust(arguments: argparse.Namespace, point: OperatingPoint, duration: float) -> Gust | None:
    if arguments.gust is not None and arguments.turbulence is not None:
        raise BadInputError("--gust and --turbulence do not go together; give one of them")
    speed = point.states.speed
    if arguments.gust is not None:
        length, peak, begin = (*arguments.gust, 0.0)[:3]
        if not 0 <= begin < duration:
            raise BadInputError(f"--gust begins at {begin:g} s; the flight lasts from 0 to {duration:g} s")
        return OneMinusCosine(length, peak, speed, begin)
    if arguments.turbulence is not None:
        intensity, scale = arguments.turbulence
        return Dryden(intensity, scale, speed, _TICK, round(duration / _TICK), seed_of(arguments))
    return None


def add_signal(parser: argparse._ActionsContainer, option: str, about: str) -> None:
    """An option of a signal: constants, and a sine for some states."""
    form = "NAME=CONSTANT[:AMPLITUDE:RAD/S]"
    add_named(parser, option, _constant_or_wave, form, f"{about}; or `{PAPER}`", alone=PAPER)


def _initial_of(given: dict[str, float] | str | None) -> np.ndarray:
    """What --initial says as a deviation from trim, (7,)."""
    start = np.zeros(len(STATES))
    if isinstance(given, str):
        start[LINEAR_ROWS] = paper_flight.INITIAL
        return start
    for name, value in (given or {}).items():
        start[STATES.index(name)] = value
    return start


def _signal_of(name: str, given: dict[str, tuple[float, ...]] | str | None) -> Signal:
    """What the option of a signal says, (6,): constants, and a sine with its frequency for some."""
    if isinstance(given, str):
        paper = {"reference": paper_flight.REFERENCE, "disturbance": paper_flight.DISTURBANCE}
        return paper.get(name, paper_flight.NOISE)
    constant, harmonics = np.zeros(len(LINEAR_STATES)), []
    for state, (value, *wave) in (given or {}).items():
        index = LINEAR_STATES.index(state)
        constant[index] = value
        if wave:
            sine = np.zeros(len(LINEAR_STATES))
            sine[index], frequency = wave
            harmonics.append(Harmonic(frequency, sine, np.zeros(len(sine))))
    return Signal(constant, np.zeros(len(LINEAR_STATES)), tuple(harmonics))


def _initial(name: str, text: str) -> float:
    """The type of --initial."""
    _check_state(name, STATES)
    return quantity(name, text)


def _constant_or_wave(name: str, text: str) -> tuple[float, ...]:
    """The type of a signal: (constant,) or (constant, amplitude, rad/s)."""
    _check_state(name, LINEAR_STATES)
    parts = text.split(":")
    if len(parts) not in (1, 3):
        raise argparse.ArgumentTypeError(f"is {text!r}; give {name}=CONSTANT or {name}=CONSTANT:AMPLITUDE:RAD/S")
    values = tuple(quantity(name, part) for part in parts[:2])
    if len(parts) == 1:
        return values
    frequency = number(parts[2])
    if frequency <= 0:
        raise argparse.ArgumentTypeError(f"frequency is {frequency:g} rad/s; it must be positive")
    return (*values, frequency)


def _check_state(name: str, names: tuple[str, ...]) -> None:
    if name not in names:
        raise argparse.ArgumentTypeError(f"is not among the states {', '.join(names)}")


def add_actuators(parser: argparse._ActionsContainer) -> None:
    """--actuators."""
    about = "actuators, s and deg/s, within the trim's control limits; order 1 (default) or 2"
    add_value(parser, "--actuators", numbers(_ACTUATORS, 2, "s", "deg/s", "1"), _ACTUATORS, about)


def actuators_of(arguments: argparse.Namespace) -> Actuators | None:
    """The actuators that the options name, None without them."""
    fault = getattr(arguments, "fault", None)
    if arguments.actuators is None:
        if fault is not None:
            raise BadInputError("--fault belongs to --actuators; give both")
        return None
    lag, degrees_per_second, *order = arguments.actuators
    if degrees_per_second <= 0:
        raise BadInputError(f"--actuators rate is {degrees_per_second:g} deg/s; it must be positive")
    rate = math.radians(degrees_per_second)
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    return Actuators(
        Input(*[lag] * len(lowest)),
        lowest,
        highest,
        Input(np.inf, *[rate] * (len(lowest) - 1)),
        order=int(order[0]) if order else 1,
        faults=() if fault is None else (fault,),
    )


def _fault(text: str) -> ActuatorFault:
    """The type of --fault."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"is {text!r}; give {_FAULT}")
    effectiveness, bandwidth, *begin = map(number, parts)
    return ActuatorFault(begin[0] if begin else 0.0, effectiveness, bandwidth)
