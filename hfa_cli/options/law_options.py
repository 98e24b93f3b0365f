"""Options of the law that is flown: exact, learned, from a file, or a scheduled controller, and what that follows."""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from controller.game.array_file import PlantNames
from controller.game.zero_sum import Game, published_game
from hfa_cli.options import games, shared_options as options
from hfa_cli.options.argument_types import input_file, number, quantity, whole
from hfa_cli.options.games import MATRIX_FILES
from hfa_cli.options.learning_options import add_settings, law_settings, shown_learning
from hfa_cli.options.parser import add_named, add_value
from hfa_model.outputs import OUTPUTS
from hfa_model.vectors import STATES
from hfa_support.errors import BadInputError, refuse_unknown, said_of
from hfa_support.reporting.unit_system import typed
from trim.linear.linear_model import LinearModel

if TYPE_CHECKING:
    from controller.flight.scenario import Scenario
    from controller.policy.policies import FlownLaw
    from controller.policy.signals import CommandSteps
    from hfa_model.aircraft import Aircraft
    from trim.point.operating_point import OperatingPoint

#: Laws of a simulation: the exact gain, or a learned one that comes with certificates.
LAWS = ("exact", "certified", "irl")
_STEPS = "NAME=TIME:VALUE[,TIME:VALUE...]"


def add_weights(parser: argparse.ArgumentParser) -> None:
    """--law (one of `LAWS`) or a file in its place, --set, --seed, --delta, --Q, --R."""
    parser.add_argument("--law", default="certified", metavar="NAME", help=f"{', '.join(LAWS)}; default certified")
    add_settings(parser)
    add_value(parser, "--seed", whole(0), "N", "seed of the recorded data and of the turbulence; default 0")
    games.add_weights(parser)


def game_on(model: LinearModel, arguments: argparse.Namespace) -> Game:
    """The published game on a model, with the weights that the options name."""
    return published_game(model.A, model.B, **games.weights_of(arguments))


def law_of(arguments: argparse.Namespace) -> str:
    """The law that the options name, one of `LAWS`."""
    law: str = arguments.law
    refuse_unknown("unknown law", law, LAWS)
    return law


def check_learning(arguments: argparse.Namespace) -> None:
    """BadInputError for an unknown law, and for options of learning where nothing is learned."""
    stored = check_stored(arguments)
    if law_of(arguments) != "exact" and not stored:
        return
    for name in ("online", "set"):
        if getattr(arguments, name, None):
            raise BadInputError(f"--{name} belongs to a learning law; with --law exact there is nothing to learn")
    if arguments.seed is not None and getattr(arguments, "turbulence", None) is None:
        raise BadInputError("--seed belongs to a learning law or to --turbulence; here nothing is random")


def seed_of(arguments: argparse.Namespace) -> int:
    """The seed that the options name."""
    return 0 if arguments.seed is None else int(arguments.seed)


def add_stored(parser: argparse.ArgumentParser) -> None:
    """--weights."""
    about = f"use this gain K, or the policy of the critic W or P, instead of a law ({' '.join(MATRIX_FILES)})"
    add_value(parser, "--weights", input_file(*MATRIX_FILES), "FILE", about)


def check_stored(arguments: argparse.Namespace) -> bool:
    """Whether a file takes the place of a law; BadInputError for options that then would change nothing."""
    if getattr(arguments, "weights", None) is None:
        return False
    if arguments.law != "certified" or arguments.set or getattr(arguments, "online", False):
        raise BadInputError("--weights takes the place of a law; leave out --law, --set and --online")
    options.refuse(arguments, ("delta", "Q"), "belongs to the game of a law; leave it out with --weights")
    return True


def stored_law(arguments: argparse.Namespace, game: Game, plant: PlantNames) -> FlownLaw:
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


def flown_law_of(arguments: argparse.Namespace, model: LinearModel, online_tick: float | None = None) -> FlownLaw:
    """The gain that is used: exact, or learned on the linear model and frozen, or learned in flight tick by tick, s."""
    from controller.policy.learned_gain import frozen_law, learned_value, online_law
    from controller.policy.policies import gain_law
    from controller.riccati.gare import solve_game

    game = game_on(model, arguments)
    if check_stored(arguments):
        return stored_law(arguments, game, PlantNames(model.states, model.inputs, model.state_units))
    if arguments.law == "exact":
        return gain_law("exact", solve_game(game).K)
    learned = learned_value(game, arguments.law, seed_of(arguments), shown_learning(), **law_settings(arguments))
    if online_tick is None:
        return frozen_law(arguments.law, learned)
    return online_law(game, arguments.law, learned, online_tick)


def add_controller(parser: argparse.ArgumentParser) -> None:
    """--controller, --command."""
    group = parser.add_argument_group("a controller instead of a law")
    about = "fly this scheduled controller (.npz) behind --actuators"
    add_value(group, "--controller", input_file(".npz"), "FILE", about)
    about = "steps off trim, s and degrees, through the command filter; repeatable"
    add_named(group, "--command", _steps, _STEPS, about)


def controlled(
    arguments: argparse.Namespace, aircraft: Aircraft, point: OperatingPoint, scenario: Scenario
) -> tuple[FlownLaw | None, Scenario]:
    """The law of --controller, None without one, and the scenario with its commands as reference.

    BadInputError where it does not fit the other options.
    """
    from controller.design.scheduled_controller import load_controller
    from controller.policy.servo_policy import servo_law
    from controller.policy.signals import CommandedStates

    if arguments.controller is None:
        if arguments.command:
            raise BadInputError("--command belongs to --controller; give both")
        return None, scenario
    if arguments.law != "certified" or arguments.set or getattr(arguments, "online", False):
        raise BadInputError("--controller takes the place of a law; leave out --law, --set and --online")
    others = ("reference", "check", "weights", "delta", "Q", "R")
    known = tuple(name for name in others if hasattr(arguments, name))
    options.refuse(arguments, known, "belongs to a gain; leave it out with --controller")
    if arguments.actuators is None:
        raise BadInputError("--controller flies behind actuators; add --actuators LAG:RATE")
    controller = load_controller(arguments.controller)
    commands = commands_of(arguments, controller.command_filter)
    return servo_law(controller, commands, aircraft, point), replace(scenario, reference=CommandedStates(commands))


def commands_of(arguments: argparse.Namespace, command_filter: tuple[float, ...]) -> CommandSteps:
    """What --command says, on the times of all names."""
    from controller.policy.signals import CommandSteps

    given: dict[str, list[tuple[float, float]]] = arguments.command or {}
    times = sorted({time for steps in given.values() for time, _ in steps})
    values = np.zeros((len(times), len(given)))
    for column, steps in enumerate(given.values()):
        for time, value in steps:
            values[times.index(time) :, column] = value
    return CommandSteps(tuple(given), np.array(times), values, *command_filter)


def _output_unit(name: str) -> str:
    return OUTPUTS[name].unit if name in OUTPUTS else "1"


def _steps(name: str, text: str) -> list[tuple[float, float]]:
    """The type of --command: (time, value) pairs, increasing."""
    found = []
    for part in text.split(","):
        time, colon, value = part.partition(":")
        if not colon:
            raise argparse.ArgumentTypeError(f"is {text!r}; give {_STEPS}")
        found.append(
            (number(time), quantity(name, value) if name in STATES else typed(number(value), _output_unit(name)))
        )
    if found[0][0] < 0.0 or any(late <= early for (early, _), (late, _) in pairwise(found)):
        raise argparse.ArgumentTypeError(f"is {text!r}; the times must increase, from 0 on")
    return found
