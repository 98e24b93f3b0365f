"""Options of a flight: the policy that flies, and what happens; what they name as a law and a
`Scenario`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.flight.actuators import ActuatorBank, ActuatorFault
from controller.flight.air import UPDRAFT, gust_speed
from controller.flight.envelope import control_limits, flight_envelope
from controller.flight.gusts import Dryden, Gust, OneMinusCosine
from controller.flight.scenario import Scenario, Uncertainty
from controller.flight.signals import CommandedStates, CommandSteps, Waveform
from hfa.options import games, trims
from hfa.options.argument_types import input_file, model, number, numbers, quantity, span
from hfa.options.parser import Option, Options
from hfa.output import ProgressLine
from hfa_aircraft.model import Model, record
from hfa_support.errors import BadInputError, refuse_unknown
from hfa_support.files import MATRIX_FILES
from trim.limits import Limits
from trim.linear.linear_model import LinearModel, linearize
from trim.point.operating_point import OperatingPoint

if TYPE_CHECKING:
    from controller.flight.policies import GainPolicy, Policy

#: No law: the commands are of inputs.
NONE = "none"
#: How help shows the values of options.
_COMMAND = "NAME=TIME:VALUE[,TIME:VALUE...]"
_GUST, _TURBULENCE = "LENGTH:PEAK[:BEGIN]", "SIGMA:SCALE"
_ACTUATORS, _FAULT = "LAG:RATE[:ORDER]", "EFFECTIVENESS:BANDWIDTH[:BEGIN]"
#: What flies in place of a law -> options that then would change nothing.
_IN_PLACE = {
    "controller": ("law", "set", "weights", "delta", "Q", "R"),
    "weights": ("law", "set", "delta", "Q"),
}


def weights(
    about: str = "use this gain K, or the policy of the critic W or P, instead of a law",
) -> Options:
    """--weights."""
    return {
        "--weights": Option(
            f"{about} ({' '.join(MATRIX_FILES)})", "FILE", input_file(*MATRIX_FILES)
        )
    }


def law(*more: str) -> Options:
    """--law, one of the laws or of `more`, its settings and its game."""
    return {**games.learning(*more, "exact"), **games.WEIGHTS}


CONTROLLER: Options = {
    "--controller": Option(
        "a scheduled controller of hfa design, instead of a law", "FILE", input_file(".npz")
    )
}
_OWN_ACTUATORS = "actuators, s and deg/s, within the trim's control limits; order 1 (default) or 2"
ACTUATORS: Options = {
    "--actuators": Option(
        _OWN_ACTUATORS, _ACTUATORS, numbers(_ACTUATORS, "s", "deg/s", "1", otherwise=(1.0,))
    )
}
_OWN_ENVELOPE = "other limits of a state, absolute (alpha: through the air); repeatable"
ENVELOPE: Options = {"--envelope": Option(_OWN_ENVELOPE, "NAME=LOW:HIGH", span, named=True)}


def commands() -> Options:
    """--controller and --command."""
    about = (
        f"steps to follow, s and degrees off trim; with --law {NONE} steps of inputs; repeatable"
    )
    return {**CONTROLLER, "--command": Option(about, _COMMAND, _command, named=True)}


def scenario(duration: float | None = 20.0, *, members: bool = False) -> Options:
    """What happens in the flight besides a reference; everything is off by default.

    duration: s; None for 20 s more than a change takes. members: --error, --noise and --turbulence
    are drawn for each."""
    own = model()
    states, air = among(own.linear, quantity), among((*own.linear, *own.disturbances), quantity)
    initial = among(tuple(own.states), quantity)
    wind = own.unit(UPDRAFT) if UPDRAFT in own.disturbances else "ft/s"
    length = wind.removesuffix("/s")
    gust = numbers(_GUST, length, wind, "s", otherwise=(0.0,))
    factor, value, deviation = "NAME=FACTOR", "NAME=VALUE", "NAME=DEVIATION"
    fixed: Options = {
        "--error": Option(
            "factor on a parameter of the simulated aircraft alone", factor, _number, named=True
        ),
        "--noise": Option("added to what a sensor says", value, states, named=True),
        "--gust": Option("1-cosine updraft, ft, ft/s and s", _GUST, gust),
    }
    drawn: Options = {
        "--error": Option(
            "relative standard deviation of a parameter", deviation, _number, named=True
        ),
        "--noise": Option(
            "standard deviation of a sensor, degrees for angles", deviation, states, named=True
        ),
    }
    disturbed = "added to the rate of a state, or a disturbance of the model"
    fault = "actuators of the surfaces from BEGIN on: share of the command that arrives, bandwidth in rad/s"
    turbulence = "Dryden turbulence, ft/s and ft, from --seed"
    return {
        "--duration": Option(
            f"default {duration or '20 more than the change takes'}", "S", number, duration
        ),
        "--initial": Option("a state off trim at the start, degrees", value, initial, named=True),
        "--disturbance": Option(disturbed, value, air, named=True),
        **ACTUATORS,
        "--fault": Option(fault, _FAULT, numbers(_FAULT, "1", "1", "s", otherwise=(0.0,))),
        "--delay": Option("time by which every command of the policy comes late", "S", number, 0.0),
        "--turbulence": Option(turbulence, _TURBULENCE, numbers(_TURBULENCE, wind, length)),
        **(drawn if members else fixed),
        **ENVELOPE,
    }


def among(names: tuple[str, ...], kind: Callable[[str, str], Any]) -> Callable[[str, str], Any]:
    """The kind of the values of some names."""

    def convert(name: str, text: str) -> Any:
        if name not in names:
            raise BadInputError(f"is not among {', '.join(names)}")
        return kind(name, text)

    return convert


def _number(_: str, text: str) -> float:
    return number(text)


def _command(name: str, text: str) -> list[tuple[float, float]]:
    """(time, value) pairs, increasing."""
    pairs = [part.split(":") for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise BadInputError(f"is {text!r}; give {_COMMAND}")
    found = [(number(time), quantity(name, value)) for time, value in pairs]
    if found[0][0] < 0.0 or any(late <= early for (early, _), (late, _) in pairwise(found)):
        raise BadInputError(f"is {text!r}; the times must increase, from 0 on")
    return found


# The policy.


def check_policy(arguments: argparse.Namespace) -> None:
    """BadInputError for an unknown law, and for options that have no effect on the policy."""
    law, instead = arguments.law, [name for name in _IN_PLACE if name in arguments.given]
    for name in instead:
        trims.refuse(arguments, _IN_PLACE[name], f"changes nothing beside --{name}; leave it out")
    if law == NONE:
        trims.refuse(
            arguments, ("delta", "Q", "R"), f"belongs to a law; leave it out with --law {NONE}"
        )
    if law != games.DEFAULT_LAW or instead:
        trims.refuse(
            arguments,
            ("set",),
            f"belongs to a learning law; with --law {law} there is nothing to learn",
        )
        if not (hasattr(arguments, "samples") or "turbulence" in arguments.given):
            trims.refuse(
                arguments,
                ("seed",),
                "belongs to a learning law or to --turbulence; here nothing is random",
            )


def flown_law_of(arguments: argparse.Namespace, linear: LinearModel) -> GainPolicy:
    """The gain that is used: of a file, exact, or learned on the linear model."""
    from controller.critic.critic_file import critic_in
    from controller.flight.policies import GainPolicy
    from controller.game.user_files import PlantNames
    from controller.learning.certified import learned_value
    from controller.riccati.gare import solve_game

    game, law, path = (
        games.game_on(arguments, linear),
        arguments.law,
        getattr(arguments, "weights", None),
    )
    if path is None and law == "exact":
        return GainPolicy("exact", solve_game(game).K)
    if path is None:
        return GainPolicy(
            law, learned_value(game, law, arguments.seed, ProgressLine("learn"), **arguments.set).K
        )
    critic = critic_in(path, game, PlantNames(linear.states, linear.inputs, linear.state_units))
    kind = "gain" if critic.feedback is None else "weights"
    return GainPolicy(f"{kind} of {path}", critic.K)


def flight_of(
    arguments: argparse.Namespace,
) -> tuple[Model, OperatingPoint, Policy, Scenario, Limits]:
    """What flies from where, by which law, through what, within which limits; the commands are the
    reference."""
    from controller.flight.policies import open_loop
    from controller.servo.scheduled_controller import load_controller
    from controller.servo.servo_policy import servo_policy

    check_policy(arguments)
    model = trims.aircraft_of(arguments)
    point = trims.point_of(arguments, model)
    happens, steps, states = (
        scenario_of(arguments, point),
        _steps_of(arguments.command),
        point.model.linear,
    )
    if arguments.controller is not None:
        if arguments.actuators is None:
            raise BadInputError("--controller flies behind actuators; add --actuators LAG:RATE")
        controller = load_controller(arguments.controller, model)
        steps = CommandSteps(steps.names, steps.times, steps.values, *controller.command_filter)
        happens = replace(happens, reference=CommandedStates(steps, states))
        policy: Policy = servo_policy(controller, steps, model, point)
    elif arguments.law == NONE:
        policy = open_loop(steps, tuple(point.model.inputs), happens.tick, happens.ticks)
    else:
        for name in steps.names:
            refuse_unknown("a gain follows no command of", name, states)
        if steps.names:
            happens = replace(happens, reference=CommandedStates(steps, states, filtered=False))
        policy = flown_law_of(arguments, linearize(model, point))
    return model, point, policy, happens, flight_envelope(model, point, arguments.envelope)


def _steps_of(given: dict[str, list[tuple[float, float]]]) -> CommandSteps:
    """The steps of --command on the times of all names."""
    times = sorted({time for steps in given.values() for time, _ in steps})
    values = np.zeros((len(times), len(given)))
    for column, steps in enumerate(given.values()):
        for time, value in steps:
            values[times.index(time) :, column] = value
    return CommandSteps(tuple(given), np.array(times), values)


# What happens.


def scenario_of(arguments: argparse.Namespace, point: OperatingPoint) -> Scenario:
    """The scenario that the options name, about a trim; of members the random quantities of each.

    The tick is 0.01 s, or the longest shorter one of which the delay is a whole number.
    """
    duration, delay, own = arguments.duration, arguments.delay, point.model
    if delay and not 0.0 < delay < duration:
        raise BadInputError(f"--delay is {delay:g} s; it must lie between 0 and the duration")
    disturbed, names = arguments.disturbance, own.linear
    common = Scenario(
        duration=duration,
        tick=math.gcd(10, round(1000.0 * delay)) / 1000.0,
        initial=np.array([arguments.initial.get(name, 0.0) for name in own.states]),
        disturbance=_constant([disturbed.get(name, 0.0) for name in names]),
        actuators=actuators_of(arguments),
        delay=delay,
        air={name: _constant([value]) for name, value in disturbed.items() if name not in names},
    )
    errors, noise = arguments.error, arguments.noise
    if hasattr(arguments, "samples"):
        return replace(common, uncertainty=Uncertainty(errors, noise, arguments.turbulence)).on(own)
    added = _constant([noise.get(name, 0.0) for name in names])
    return replace(common, noise=added, errors=errors, gust=_gust(arguments, point, common)).on(own)


def _gust(arguments: argparse.Namespace, point: OperatingPoint, happens: Scenario) -> Gust | None:
    if arguments.gust is not None and arguments.turbulence is not None:
        raise BadInputError("--gust and --turbulence do not go together; give one of them")
    if arguments.gust is not None:
        length, peak, begin = arguments.gust
        if not 0 <= begin < happens.duration:
            raise BadInputError(
                f"--gust begins at {begin:g} s; the flight lasts from 0 to {happens.duration:g} s"
            )
        return OneMinusCosine(length, peak, gust_speed(point), begin)
    if arguments.turbulence is not None:
        intensity, scale = arguments.turbulence
        return Dryden(
            intensity, scale, gust_speed(point), happens.tick, happens.ticks, arguments.seed
        )
    return None


def _constant(values: list[float]) -> Waveform:
    return Waveform(np.array(values), np.zeros(len(values)))


def actuators_of(arguments: argparse.Namespace) -> ActuatorBank | None:
    """The actuators that the options name, None without them: of the surfaces, inputs in rad or
    deg, with that rate."""
    fault = getattr(arguments, "fault", None)
    if arguments.actuators is None:
        if fault is not None:
            raise BadInputError("--fault belongs to --actuators; give both")
        return None
    lag, degrees_per_second, order = arguments.actuators
    if degrees_per_second <= 0:
        raise BadInputError(
            f"--actuators rate is {degrees_per_second:g} deg/s; it must be positive"
        )
    own = model()
    rates = {"rad": math.radians(degrees_per_second), "deg": degrees_per_second}
    surfaces = tuple(name for name, each in own.inputs.items() if each.unit in rates)
    faults = []
    if fault is not None:
        effectiveness, bandwidth, begin = fault
        faults.append(ActuatorFault(begin, effectiveness, bandwidth, inputs=surfaces))
    values: Any = record(tuple(own.inputs))
    limits = control_limits(own)
    lowest = values(*limits.lowest.tolist())
    highest = values(*limits.highest.tolist())
    fastest = values(*(rates.get(each.unit, math.inf) for each in own.inputs.values()))
    lags = values(*[lag] * len(own.inputs))
    return ActuatorBank(lags, lowest, highest, fastest, order=int(order), faults=tuple(faults))
