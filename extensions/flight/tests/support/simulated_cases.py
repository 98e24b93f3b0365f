"""Flights shared by several test files: a trim with its game, gain and envelope, built once."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from known_models import exact_gain, game_at, model_at

import hfa
from hfa import Game, Model, OperatingPoint, fly
from hfa_aircraft.limits import Limits
from hfa_flight import GainPolicy, Policy, Scenario, Waveform, flight_envelope
from hfa_flight.nonlinear_flight import Flight
from hfa_flight.policies import Measurements
from hfa_model import LINEAR_STATES, Parameters

N = len(LINEAR_STATES)
SMALL = np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02])


@dataclass(frozen=True, eq=False)
class SimulatedCase:
    """A trim of an aircraft, with its game, exact gain and envelope."""

    aircraft: Model
    point: OperatingPoint
    game: Game
    law: Policy
    envelope: Limits


def case_at(parameters: Parameters, dynamics: str, degrees: float) -> SimulatedCase:
    point = model_at(degrees, dynamics).point
    law = GainPolicy("exact", exact_gain(degrees, dynamics))
    aircraft = hfa.aircraft(dynamics, parameters)
    return SimulatedCase(
        aircraft, point, game_at(degrees, dynamics), law, flight_envelope(aircraft, point)
    )


def simulate_case(on: SimulatedCase, scenario: Scenario) -> Flight:
    return fly(on.aircraft, on.point, on.law, scenario=scenario, envelope=on.envelope)


def measurements_of(z: ca.SX) -> Measurements:
    """Return what a policy measures for an error z about a constant reference, without
    actuators.
    """
    return Measurements(z, z, ca.SX(0, 1), ca.SX(0, 1))


def signal(**values: float) -> Waveform:
    return Waveform(np.array([values.get(name, 0.0) for name in LINEAR_STATES]), np.zeros(N))


@pytest.fixture(scope="session", params=["published", "newton"])
def at_15(request: pytest.FixtureRequest, parameters: Parameters) -> SimulatedCase:
    """Return the trim at 15 degrees with the exact gain, for the published and the Newton
    equations.
    """
    return case_at(parameters, request.param, 15.0)


@pytest.fixture(scope="session")
def newton(parameters: Parameters) -> SimulatedCase:
    return case_at(parameters, "newton", 15.0)
