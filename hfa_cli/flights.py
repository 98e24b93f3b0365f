"""Options of a nonlinear flight, and the scenario that they name."""

from __future__ import annotations

import argparse

import numpy as np

from controller.flight.actuators import Actuators
from controller.flight.gusts import Dryden, Gust, OneMinusCosine
from controller.flight.signals import Harmonic, Signal
from controller.flight.simulate import Scenario
from controller.game.zero_sum import Game, published_game
from hfa_cli import games
from hfa_cli.learning import add_settings
from hfa_cli.values import number, quantity, span, split_assignments, whole
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES, STATES, Input
from trim.linear.linearize import LinearModel
from trim.point.condition import CONTROL_LIMITS
from trim.point.operating_point import OperatingPoint
from verification.experiments.configuration import section5_configuration

#: Laws that fly: the exact gain, or a learned one that comes with certificates.
LAWS = ("exact", "certified", "irl")
#: In place of NAME=...: what the paper flies in Section 5, as `verification/experiments/section5.toml` reads it.
PAPER = "paper"
_TICK = 0.01


def add_scenario(parser: argparse.ArgumentParser) -> None:
    """What happens in the flight; everything is off by default."""
    form = "NAME=CONSTANT[:AMPLITUDE:RAD/S]"
    parser.add_argument("--duration", metavar="S", help="default 20")
    parser.add_argument("--step", metavar="S", help="fixed step of the integration, default 0.001")
    parser.add_argument(
        "--initial", action="append", metavar="NAME=VALUE", help="a state off trim at the start, degrees; or `paper`"
    )
    parser.add_argument("--reference", action="append", metavar=form, help="what a state shall follow; or `paper`")
    parser.add_argument("--disturbance", action="append", metavar=form, help="added to the rate of a state; or `paper`")
    parser.add_argument("--noise", action="append", metavar=form, help="added to what a sensor says; or `paper`")
    parser.add_argument(
        "--error",
        action="append",
        metavar="NAME=FACTOR",
        help="a parameter of the flown aircraft that the design misses",
    )
    parser.add_argument(
        "--actuators", metavar="LAG:RATE", help="first-order actuators, s and deg/s, within the trim's control limits"
    )
    parser.add_argument("--engine", metavar="LAG:RATE", help="another lag and rate for the throttle, s and 1/s")
    parser.add_argument("--gust", metavar="LENGTH:PEAK[:BEGIN]", help="1-cosine updraft, ft, ft/s and s")
    parser.add_argument("--turbulence", metavar="SIGMA:SCALE", help="Dryden turbulence, ft/s and ft, from --seed")
    parser.add_argument(
        "--envelope", action="append", metavar="NAME=LOW:HIGH", help="other limits of a state, absolute; repeatable"
    )


def add_weights(parser: argparse.ArgumentParser, laws: tuple[str, ...] = LAWS) -> None:
    """--law (one of `laws`), --set, --seed, --delta, --Q, --R."""
    parser.add_argument("--law", default="certified", metavar="NAME", help=f"{', '.join(laws)}; default certified")
    add_settings(parser)
    parser.add_argument("--seed", metavar="N", help="seed of the recorded data and of the turbulence; default 0")
    games.add_weights(parser)


def game_on(model: LinearModel, arguments: argparse.Namespace) -> Game:
    """The published game on a model, with the weights that the options name."""
    return published_game(model.A, model.B, **games.weights_of(arguments))


def law_of(arguments: argparse.Namespace, laws: tuple[str, ...] = LAWS) -> str:
    """The law that the options name, one of `laws`."""
    law: str = arguments.law
    if law not in laws:
        raise BadInputError(f"unknown law {law!r}; choose one of: {', '.join(laws)}")
    return law


def seed_of(arguments: argparse.Namespace) -> int:
    """The seed that the options name."""
    return whole("--seed", arguments.seed, 0, lowest=0)


def scenario_of(arguments: argparse.Namespace, point: OperatingPoint, duration: float = 20.0) -> Scenario:
    """The scenario that the options name, about a trim. duration: unless given, s."""
    duration = duration if arguments.duration is None else number(arguments.duration, "--duration")
    step = 0.001 if arguments.step is None else number(arguments.step, "--step")
    scenario = Scenario(
        duration=duration,
        step=step,
        tick=_TICK,
        initial=initial_of(arguments.initial),
        reference=signal_of("--reference", arguments.reference),
        disturbance=signal_of("--disturbance", arguments.disturbance),
        noise=signal_of("--noise", arguments.noise),
        errors={name: number(text, name) for name, text in split_assignments(arguments.error).items()},
        actuators=_actuators(arguments),
    )
    return scenario.with_gust(_gust(arguments, point.states.speed, scenario))


def envelope_changes(words: list[str] | None) -> dict[str, tuple[float, float]]:
    """`NAME=LOW:HIGH` words of --envelope, in internal units."""
    changes = {}
    for name, text in split_assignments(words).items():
        _known("--envelope", name, STATES)
        changes[name] = span(name, text)
    return changes


def initial_of(words: list[str] | None) -> np.ndarray:
    """`NAME=VALUE` words of --initial as a deviation from trim, (7,)."""
    start = np.zeros(len(STATES))
    if words == [PAPER]:
        start[[STATES.index(name) for name in LINEAR_STATES]] = section5_configuration().initial
        return start
    for name, text in split_assignments(words).items():
        _known("--initial", name, STATES)
        start[STATES.index(name)] = quantity(name, text)
    return start


def signal_of(option: str, words: list[str] | None) -> Signal:
    """`NAME=CONSTANT[:AMPLITUDE:RAD/S]` words of an option, (6,)."""
    if words == [PAPER]:
        paper = section5_configuration()
        signals = {"--reference": paper.reference, "--disturbance": paper.disturbance, "--noise": paper.noise}
        return signals[option].signal
    constant = np.zeros(len(LINEAR_STATES))
    harmonics = []
    for name, text in split_assignments(words).items():
        _known(option, name, LINEAR_STATES)
        parts = text.split(":")
        if len(parts) not in (1, 3):
            raise BadInputError(f"{option} {name} is {text!r}; give {name}=CONSTANT or {name}=CONSTANT:AMPLITUDE:RAD/S")
        index = LINEAR_STATES.index(name)
        constant[index] = quantity(name, parts[0])
        if len(parts) == 3:
            sine = np.zeros(len(LINEAR_STATES))
            sine[index] = quantity(name, parts[1])
            frequency = number(parts[2], f"{option} {name} frequency")
            if frequency <= 0:
                raise BadInputError(f"{option} {name} frequency is {frequency:g} rad/s; it must be positive")
            harmonics.append(Harmonic(frequency, sine, np.zeros(len(sine))))
    return Signal(constant, np.zeros(len(LINEAR_STATES)), tuple(harmonics))


def _actuators(arguments: argparse.Namespace) -> Actuators | None:
    if arguments.actuators is None:
        if arguments.engine is not None:
            raise BadInputError("--engine belongs to --actuators; give both")
        return None
    lag, degrees_per_second = numbers("--actuators", arguments.actuators, "LAG:RATE", (2,))
    if degrees_per_second <= 0:
        raise BadInputError(f"--actuators rate is {degrees_per_second:g} deg/s; it must be positive")
    rate = quantity("dihedral", str(degrees_per_second))  # degrees to radians as everywhere else
    engine_lag, engine_rate = lag, np.inf
    if arguments.engine is not None:
        engine_lag, engine_rate = numbers("--engine", arguments.engine, "LAG:RATE", (2,))
    lowest, highest = (Input(*(pair[side] for pair in CONTROL_LIMITS)) for side in (0, 1))
    surfaces = len(lowest) - 1
    return Actuators(Input(engine_lag, *[lag] * surfaces), lowest, highest, Input(engine_rate, *[rate] * surfaces))


def _gust(arguments: argparse.Namespace, speed: float, scenario: Scenario) -> Gust | None:
    if arguments.gust is not None and arguments.turbulence is not None:
        raise BadInputError("--gust and --turbulence do not go together; give one of them")
    if arguments.gust is not None:
        length, peak, *begin = numbers("--gust", arguments.gust, "LENGTH:PEAK[:BEGIN]", (2, 3))
        if begin and not 0 <= begin[0] < scenario.duration:
            raise BadInputError(f"--gust begins at {begin[0]:g} s; the flight lasts from 0 to {scenario.duration:g} s")
        return OneMinusCosine(length, peak, speed, *begin)
    if arguments.turbulence is not None:
        intensity, scale = numbers("--turbulence", arguments.turbulence, "SIGMA:SCALE", (2,))
        return Dryden(intensity, scale, speed, scenario.tick, scenario.ticks, seed_of(arguments))
    return None


def numbers(option: str, text: str, form: str, counts: tuple[int, ...]) -> list[float]:
    """Numbers between colons, as many as one of `counts`; BadInputError shows the form."""
    parts = text.split(":")
    if len(parts) not in counts:
        raise BadInputError(f"{option} is {text!r}; give {form}")
    return [number(part, option) for part in parts]


def _known(option: str, name: str, names: tuple[str, ...]) -> None:
    if name not in names:
        raise BadInputError(f"{option} has no state {name!r}; choose from {', '.join(names)}")
