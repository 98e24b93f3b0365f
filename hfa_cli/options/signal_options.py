"""Options of where a flight begins, and of the signals in it: commands, disturbances, noise."""

from __future__ import annotations

import argparse

import numpy as np

from controller.policy.signals import Harmonic, Signal
from hfa_cli.options.argument_types import number, quantity
from hfa_cli.options.parser import add_named
from hfa_model.vectors import LINEAR_STATES, STATES
from verification.experiments.configuration import section5_configuration

#: In place of NAME=...: what the paper simulates in Section 5, as `verification/experiments/section5.toml` reads it.
PAPER = "paper"


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
        start[[STATES.index(name) for name in LINEAR_STATES]] = section5_configuration().initial
        return start
    for name, value in (given or {}).items():
        start[STATES.index(name)] = value
    return start


def signal_of(name: str, given: dict[str, tuple[float, ...]] | str | None) -> Signal:
    """What the option of a signal says, (6,): constants, and a sine with its frequency for some."""
    if isinstance(given, str):
        paper = section5_configuration()
        return {"reference": paper.reference, "disturbance": paper.disturbance, "noise": paper.noise}[name].signal
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
