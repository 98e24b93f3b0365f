"""A Monte Carlo plan for tests, and functions that change it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hfa
from hfa import OperatingPoint
from hfa.paper import default_parameters
from hfa_flight import GainPolicy, MonteCarlo, Scenario, Uncertainty, Waveform, flight_envelope
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.signals import Harmonic

PARAMETERS = default_parameters().values
EVERYTHING = Uncertainty(
    errors={"panel_mass": 0.05, "lift_slope": 0.03, "hinge_stiffness": 0.1},
    noise={"alpha": 0.002, "pitch_rate": 0.004},
    turbulence=Turbulence((3.0, 1750.0)),
)


@pytest.fixture
def plan(point: OperatingPoint, gain: np.ndarray) -> MonteCarlo:
    """Return a Monte Carlo plan of twelve short flights with every kind of random quantity."""
    wave = Harmonic(3.0, np.full(6, 1e-3), np.zeros(6))
    scenario = Scenario(
        duration=0.5,
        initial=0.1 * np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02]),
        reference=Waveform(np.array([0.1, 0, 0, 0, 0.01, 0]), np.zeros(6)),
        disturbance=Waveform(np.zeros(6), np.zeros(6), (wave,)),
        uncertainty=EVERYTHING,
    )
    aircraft = hfa.aircraft(parameters=PARAMETERS)
    law = GainPolicy("exact", gain)
    envelope = flight_envelope(aircraft, point)
    return MonteCarlo(12, 7, aircraft, point, law, scenario, envelope)


def with_scenario(plan: MonteCarlo, **changes: Any) -> MonteCarlo:
    return replace(plan, scenario=replace(plan.scenario, **changes))
