"""A trim with its game, gain and envelope, shared by tests that simulate."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_models import exact_gain, game_at, model_at

import hfa
from hfa import Game, Model, OperatingPoint
from hfa_flight import GainPolicy, Policy, flight_envelope
from hfa_model import Parameters

SMALL = np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02])


@dataclass(frozen=True, eq=False)
class SimulatedCase:
    """A trim of an aircraft, with its game, exact gain and envelope."""

    aircraft: Model
    point: OperatingPoint
    game: Game
    law: Policy
    envelope: Any


@pytest.fixture(scope="session")
def newton(parameters: Parameters) -> SimulatedCase:
    """Return the trim at 15 degrees with the exact gain, for Newton's equations."""
    point = model_at(15.0, "newton").point
    aircraft = hfa.aircraft("newton", parameters)
    law = GainPolicy("exact", exact_gain(15.0, "newton"))
    game = game_at(15.0, "newton")
    return SimulatedCase(aircraft, point, game, law, flight_envelope(aircraft, point))


def measurements_of(z: ca.SX) -> Any:
    """Return what a policy measures for an error z about a constant reference, without
    actuators.
    """
    none = ca.SX(0, 1)
    return SimpleNamespace(error=z, states=z, positions=none, rates=none, updraft=none, since=none)
