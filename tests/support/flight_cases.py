"""What tests of flights fly: one trim with its game, exact gain and envelope."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from known_models import exact_gain, game_at, model_at

from controller import Envelope, FlownLaw, Game, Scenario, Signal, flight_envelope, fly, gain_law
from controller.flight.nonlinear_flight import NonlinearFlight
from controller.policy.policies import Seen
from hfa_model import LINEAR_STATES, Aircraft, Parameters
from trim import OperatingPoint

N = len(LINEAR_STATES)
SMALL = np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02])


@dataclass(frozen=True, eq=False)
class FlownCase:
    """One trim with its game, exact gain and envelope."""

    aircraft: Aircraft
    point: OperatingPoint
    game: Game
    law: FlownLaw
    envelope: Envelope


def case_at(parameters: Parameters, dynamics: str, degrees: float) -> FlownCase:
    point, law = model_at(degrees, dynamics).point, gain_law("exact", exact_gain(degrees, dynamics))
    aircraft = Aircraft(parameters, dynamics)
    return FlownCase(aircraft, point, game_at(degrees, dynamics), law, flight_envelope(aircraft, point))


def flown(on: FlownCase, scenario: Scenario) -> NonlinearFlight:
    return fly(on.aircraft, on.point, on.law, scenario, on.envelope)


def seen(z: ca.SX) -> Seen:
    """An error z from a reference at rest, no actuators."""
    return Seen(z, z, ca.SX(0, 1), ca.SX(0, 1))


def signal(**values: float) -> Signal:
    return Signal(np.array([values.get(name, 0.0) for name in LINEAR_STATES]), np.zeros(N))
