"""Box of states in which critics are compared with the exact solution."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from controller.game.zero_sum import Game
from controller.hfa_game import ordinary_deviations
from hfa_aircraft.signals import PlantNames
from hfa_model.parameters import INPUTS, LINEAR_STATES, LINEAR_UNITS
from hfa_support.reporting.results import Vector
from trim.linear.frequency_response import units_of


class Box(NamedTuple):
    """Box |z_i| <= half_widths[i] of states in which V, its gradient and the policies are compared.

    half_widths: (n,), in the units of the states
    about: source of the half-widths, as text
    name: name of the box in the first line of a verdict, "box" after an adjective
    """

    half_widths: Vector
    about: str
    name: str = "given box"


def ordinary_box(
    states: tuple[str, ...] = LINEAR_STATES,
    inputs: tuple[str, ...] = INPUTS,
    state_units: tuple[str, ...] = (),
) -> Box | None:
    """Return the box of typical deviations of the paper's aircraft, or None for another plant.

    states, inputs: names, which must be those of the aircraft
    state_units: units of the states, English or SI, or () if unknown
    """
    widths = ordinary_deviations(PlantNames(states, inputs, state_units))
    if widths is None:
        return None
    is_si = state_units and state_units != LINEAR_UNITS
    speed = f"{widths[0]:.4g} m/s" if is_si else f"{widths[0]:g} ft/s"
    about = f"typical deviations of the aircraft, {speed}, 0.1 rad, 0.1 rad/s"
    return Box(widths, about, "typical box")


def usual_box(game: Game) -> Box:
    """Return the box in which critics of a game are compared if no box is given.

    - the paper's aircraft: the box of typical deviations
    - a linear model whose states have limits: the largest box within them
    - otherwise: the balanced units of the game

    game: the game, or the game of one step in discrete time
    """
    names = game.names
    box = ordinary_box(names.states, names.inputs, names.state_units)
    if box is not None:
        return box
    if game.half_widths is not None:
        about = "within the limits of the states that the model declares"
        return Box(game.half_widths, about, "box of limits")
    about = "balanced units of the game (a convention, because no typical deviations are given)"
    return Box(balanced_units(game), about, "balanced box")


def balanced_units(game: Game) -> np.ndarray:
    """Return units of the states, powers of two, in which the terms of a game are of similar size,
    (n,).
    """
    plain = game.without_cross_weights
    root = math.sqrt(game.discount)
    B = root * plain.B
    price = game.R + B.T @ plain.Q @ B if game.is_discrete else game.R
    E = root * plain.E / game.delta
    return units_of(root * plain.A, B @ np.linalg.pinv(price) @ B.T + E @ E.T, plain.Q)


def starts_in(b: np.ndarray, count: int, seed: int = 1) -> np.ndarray:
    """Return random initial conditions in the box |z_i| <= b_i, (count, n).

    Every second initial condition, beginning with the first, is a corner of the box.

    b: (n,)
    """
    starts = np.random.default_rng(seed).uniform(-1.0, 1.0, (count, len(b)))
    starts[::2] = np.sign(starts[::2])
    return starts * b
