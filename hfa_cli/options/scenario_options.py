"""Options of what happens in a flight: its length, where it begins, signals, errors, actuators, the air."""

from __future__ import annotations

import argparse
import math

import numpy as np

from controller.flight.actuators import ActuatorFault, Actuators
from controller.flight.envelope import Envelope, flight_envelope
from controller.flight.gusts import Dryden, Gust, OneMinusCosine, side_by_side, spanwise_dryden
from controller.flight.scenario import Scenario
from controller.policy import paper_flight
from controller.policy.signals import Harmonic, Signal
from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import number, numbers, parsed, quantity, span
from hfa_cli.options.law_options import seed_of
from hfa_cli.options.parser import add_named, add_value
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_ROWS, LINEAR_STATES, STATES, Input
from hfa_support.errors import BadInputError
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint

#: How help shows colon-separated numbers.
_GUST, _TURBULENCE = "LENGTH:PEAK[:BEGIN[:OUTER_PEAK[:DELAY]]]", "SIGMA:SCALE[:FADE]"
_SPANWISE = ":spanwise"
_TICK = 0.01
#: In place of NAME=...: what the paper simulates in Section 5 (`controller/policy/paper_flight.py`).
PAPER = "paper"
#: How help shows colon-separated numbers.
_ACTUATORS, _FAULT = "LAG:RATE[:ORDER]", "EFFECTIVENESS:BANDWIDTH[:BEGIN]"


def add_scenario(parser: argparse.ArgumentParser, duration: str = "20") -> None:
    """What happens in the flight besides a reference; everything is off by default. duration: what help calls it."""
    add_times(parser, duration)
    add_initial(parser)
    add_signal(parser, "--disturbance", "added to the rate of a state")
    add_signal(parser, "--noise", "added to what a sensor says")
    missed = "factor on a parameter of the simulated aircraft, unknown to the design"
    add_named(parser, "--error", lambda _, text: number(text), "NAME=FACTOR", missed)
    add_actuators(parser)
    about = "1-cosine updraft, ft, ft/s and s; another peak at the outer panels, so much later"
    add_value(parser, "--gust", numbers(_GUST, 2, "ft", "ft/s", "s", "ft/s", "s"), _GUST, about)
    form = f"{_TURBULENCE}[{_SPANWISE}]"
    about = "Dryden turbulence, ft/s, ft and s, from --seed; `spanwise`: another one at the outer panels"
    add_value(parser, "--turbulence", lambda text: (turbulence(text.removesuffix(_SPANWISE)), text), form, about)
    add_envelope(parser)


def add_turbulence(parser: argparse._ActionsContainer) -> None:
    """--turbulence of members, each with its own."""
    add_value(parser, "--turbulence", turbulence, _TURBULENCE, "Dryden turbulence, ft/s, ft and s")


#: The type of turbulence: its intensity, ft/s, its scale, ft, and over how long it grows, s.
turbulence = numbers(_TURBULENCE, 2, "ft/s", "ft", "s")


def add_times(parser: argparse._ActionsContainer, duration: str = "20") -> None:
    """--duration (what help calls its default) and --step."""
    add_value(parser, "--duration", number, "S", f"default {duration}")
    add_value(parser, "--step", number, "S", "fixed step of the integration, default 0.001", default=0.001)


def add_envelope(parser: argparse._ActionsContainer) -> None:
    """--envelope: between which values each state must stay."""
    add_named(
        parser,
        "--envelope",
        span,
        "NAME=LOW:HIGH",
        "other limits of a state, absolute (alpha: through the air); repeatable",
    )


def scenario_of(arguments: argparse.Namespace, point: OperatingPoint, duration: float = 20.0) -> Scenario:
    """The scenario that the options name, about a trim. duration: unless given, s."""
    duration = duration if arguments.duration is None else arguments.duration
    return Scenario(
        duration=duration,
        step=arguments.step,
        tick=_TICK,
        initial=initial_of(arguments.initial),
        reference=signal_of("reference", getattr(arguments, "reference", None)),
        disturbance=signal_of("disturbance", arguments.disturbance),
        noise=signal_of("noise", arguments.noise),
        errors=arguments.error or {},
        actuators=actuators_of(arguments),
        gust=_gust(arguments, point, duration),
    )


def envelope_of(arguments: argparse.Namespace, aircraft: Aircraft, point: OperatingPoint) -> Envelope:
    """The envelope about a trim, with the limits that the options name."""
    return flight_envelope(aircraft.parameters, point, arguments.envelope)


def _gust(arguments: argparse.Namespace, point: OperatingPoint, duration: float) -> Gust | None:
    if arguments.gust is not None and arguments.turbulence is not None:
        raise BadInputError("--gust and --turbulence do not go together; give one of them")
    speed = point.states.speed
    if arguments.gust is not None:
        length, peak, *more = arguments.gust
        gust = _one_minus_cosine(duration, length, peak, speed, *more[:1])
        if len(more) < 2:
            return gust
        return side_by_side(gust, _one_minus_cosine(duration, length, more[1], speed, gust.begin + sum(more[2:])))
    if arguments.turbulence is not None:
        (intensity, scale, *fade), text = arguments.turbulence
        center = Dryden(intensity, scale, speed, _TICK, round(duration / _TICK), seed_of(arguments), *fade)
        if not text.endswith(_SPANWISE):
            return center
        panel = options.aircraft_of(arguments).parameters.panel_span
        return spanwise_dryden(center, panel / 2 * (1 + math.cos(point.states.dihedral)))
    return None


def _one_minus_cosine(duration: float, length: float, peak: float, speed: float, begin: float = 0.0) -> OneMinusCosine:
    if not 0 <= begin < duration:
        raise BadInputError(f"--gust begins at {begin:g} s; the flight lasts from 0 to {duration:g} s")
    return OneMinusCosine(length, peak, speed, begin)


def add_initial(parser: argparse._ActionsContainer) -> None:
    """--initial: where the states begin."""
    about = "a state off trim at the start, degrees; or `paper`"
    add_named(parser, "--initial", _initial, "NAME=VALUE", about, alone=PAPER)


def add_signal(parser: argparse._ActionsContainer, option: str, about: str) -> None:
    """An option of a signal: constants, and a sine for some states."""
    form = "NAME=CONSTANT[:AMPLITUDE:RAD/S]"
    add_named(parser, option, _constant_or_wave, form, f"{about}; or `{PAPER}`", alone=PAPER)


def initial_of(given: dict[str, float] | str | None) -> np.ndarray:
    """What --initial says as a deviation from trim, (7,)."""
    start = np.zeros(len(STATES))
    if isinstance(given, str):
        start[LINEAR_ROWS] = paper_flight.INITIAL
        return start
    for name, value in (given or {}).items():
        start[STATES.index(name)] = value
    return start


def signal_of(name: str, given: dict[str, tuple[float, ...]] | str | None) -> Signal:
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


def add_actuators(parser: argparse._ActionsContainer, faults: bool = True) -> None:
    """--actuators, and --fault unless there are none."""
    about = "actuators, s and deg/s, within the trim's control limits; order 1 (default) or 2"
    add_value(parser, "--actuators", numbers(_ACTUATORS, 2, "s", "deg/s", "1"), _ACTUATORS, about)
    if not faults:
        parser.set_defaults(fault=None)
        return
    about = "actuators of the surfaces from BEGIN on: share of the command that arrives, bandwidth in rad/s"
    add_value(parser, "--fault", parsed(_fault), _FAULT, about)


def actuators_of(arguments: argparse.Namespace) -> Actuators | None:
    """The actuators that the options name, None without them."""
    if arguments.actuators is None:
        if arguments.fault is not None:
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
        faults=() if arguments.fault is None else (arguments.fault,),
    )


def _fault(text: str) -> ActuatorFault:
    """The type of --fault."""
    parts = text.split(":")
    if len(parts) not in (2, 3):
        raise argparse.ArgumentTypeError(f"is {text!r}; give {_FAULT}")
    effectiveness, bandwidth, *begin = map(number, parts)
    return ActuatorFault(begin[0] if begin else 0.0, effectiveness, bandwidth)
