"""Options of flights under a scheduled controller: its file and what it follows."""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from hfa_cli.options import shared_options as options
from hfa_cli.options.argument_types import input_file, number, quantity
from hfa_cli.options.parser import add_named, add_value
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import STATES

if TYPE_CHECKING:
    from controller.flight.scenario import Scenario
    from controller.policy.commands import CommandSteps
    from controller.policy.flown_law import FlownLaw
    from hfa_model.aircraft import Aircraft
    from trim.point.operating_point import OperatingPoint

_STEPS = "NAME=TIME:VALUE[,TIME:VALUE...]"


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
    from controller.policy.commands import CommandedStates
    from controller.policy.servo_policy import servo_law

    if arguments.controller is None:
        if arguments.command:
            raise BadInputError("--command belongs to --controller; give both")
        return None, scenario
    if arguments.law != "certified" or arguments.set or getattr(arguments, "online", False):
        raise BadInputError("--controller takes the place of a law; leave out --law, --set and --online")
    others = ("reference", "check", "gain", "weights", "delta", "Q", "R")
    known = tuple(name for name in others if hasattr(arguments, name))
    options.refuse(arguments, known, "belongs to a gain; leave it out with --controller")
    if arguments.actuators is None:
        raise BadInputError("--controller flies behind actuators; add --actuators LAG:RATE")
    controller = load_controller(arguments.controller)
    commands = commands_of(arguments, controller.command_filter)
    return servo_law(controller, commands, aircraft, point), replace(scenario, reference=CommandedStates(commands))


def commands_of(arguments: argparse.Namespace, command_filter: tuple[float, ...]) -> CommandSteps:
    """What --command says, on the times of all names."""
    from controller.policy.commands import CommandSteps

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
        found.append((number(time), quantity(name, value) if name in STATES else number(value)))
    if found[0][0] < 0.0 or any(late <= early for (early, _), (late, _) in pairwise(found)):
        raise argparse.ArgumentTypeError(f"is {text!r}; the times must increase, from 0 on")
    return found
