"""Aircraft of many tests, made once: models, games, gains and flown cases at an angle; SimVFA's in
its own air."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.optimize import brentq

import hfa_model
from controller import (
    GainPolicy,
    Game,
    Policy,
    Scenario,
    Waveform,
    flight_envelope,
    fly,
    published_game,
)
from hfa_aircraft import Model
from hfa_flight.nonlinear_flight import NonlinearFlight
from hfa_flight.policies import Measurements
from hfa_model import LINEAR_STATES, Parameters, load_parameters
from hfa_model.atmosphere import density
from trim import LinearModel, OperatingPoint, level_model
from trim.limits import Limits
from verification import solve_game

#: Density of SimVFA (B. Thomsen, 2018) at 40,000 ft, slug/ft³; ours is 1.6e-5 of it more.
_RELEASED_DENSITY = 5.872675956988981e-4


def released_simulation() -> tuple[Model, float]:
    """SimVFA's aircraft, and the altitude, ft, at which the standard atmosphere has its air."""
    altitude = brentq(
        lambda height: float(density(height)) - _RELEASED_DENSITY, 39_000.0, 41_000.0, xtol=1e-9
    )
    return hfa_model.aircraft(parameters=load_parameters("gibson-2011-simulation").values), altitude


@lru_cache(maxsize=64)
def model_at(degrees: float, dynamics: str = "published") -> LinearModel:
    aircraft = hfa_model.aircraft(dynamics)
    return level_model(aircraft, math.radians(degrees))


@lru_cache(maxsize=64)
def game_at(degrees: float, dynamics: str = "published") -> Game:
    return published_game(model_at(degrees, dynamics))


@lru_cache(maxsize=64)
def exact_gain(degrees: float, dynamics: str = "published") -> np.ndarray:
    return solve_game(game_at(degrees, dynamics)).K


N = len(LINEAR_STATES)
SMALL = np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02])


@dataclass(frozen=True, eq=False)
class FlownCase:
    """One trim with its game, exact gain and envelope."""

    aircraft: Model
    point: OperatingPoint
    game: Game
    law: Policy
    envelope: Limits


def case_at(parameters: Parameters, dynamics: str, degrees: float) -> FlownCase:
    point = model_at(degrees, dynamics).point
    law = GainPolicy("exact", exact_gain(degrees, dynamics))
    aircraft = hfa_model.aircraft(dynamics, parameters)
    return FlownCase(
        aircraft, point, game_at(degrees, dynamics), law, flight_envelope(aircraft, point)
    )


def flown(on: FlownCase, scenario: Scenario) -> NonlinearFlight:
    return fly(on.aircraft, on.point, on.law, scenario, on.envelope)


def seen(z: ca.SX) -> Measurements:
    """An error z from a reference at rest, no actuators."""
    return Measurements(z, z, ca.SX(0, 1), ca.SX(0, 1))


def signal(**values: float) -> Waveform:
    return Waveform(np.array([values.get(name, 0.0) for name in LINEAR_STATES]), np.zeros(N))
