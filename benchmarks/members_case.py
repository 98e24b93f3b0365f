"""Monte Carlo plans that the benchmarks fly."""

from __future__ import annotations

import numpy as np

from benchmarks.flight_case import STEP, FlightCase
from controller.flight.envelope import Envelope, flight_envelope
from controller.flight.scenario import Scenario
from controller.flight.uncertain import Uncertainty
from controller.game.zero_sum import published_game
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from controller.policy.critic_policy import CriticPolicy, critic_law
from controller.policy.flown_law import FlownLaw, gain_law
from controller.policy.signals import zero
from controller.riccati.gare import solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import default_parameters
from hfa_model.vectors import State
from trim.linear.linear_model import level_model
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point

_UNCERTAIN = Uncertainty(
    errors={"panel_mass": 0.02, "lift_slope": 0.02, "hinge_damping": 0.05},
    noise={"alpha": 0.001, "pitch_rate": 0.001},
    turbulence=(1.0, 1750.0),
)
_EVERYWHERE = Envelope(State(*[-1e9] * 7), State(*[1e9] * 7))


def critic_plan(members: int, duration: float = 20.0) -> MonteCarlo:
    """The flight of `flight_case` by many members: 25 weights, 50 samples, step 1e-4 s, seven states at 5 degrees.

    The envelope is as good as none, so that every member flies to the end.
    """
    case = FlightCase()
    law = critic_law("published", CriticPolicy(case.law, zero(6)))
    initial = np.array([5.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    scenario = Scenario(duration, STEP, 0.01, initial, case.reference, case.disturbance, uncertainty=_UNCERTAIN)
    return _plan(members, 5.0, "linear", law, scenario, _EVERYWHERE)


def gain_plan(members: int, duration: float = 20.0) -> MonteCarlo:
    """The nonlinear aircraft under the exact gain at 15 degrees, step 1e-3 s."""
    aircraft = Aircraft(default_parameters().values)
    model = level_model(aircraft, float(np.radians(15.0)))
    law = gain_law("exact", solve_game(published_game(model.A, model.B)).K)
    scenario = Scenario(duration, uncertainty=_UNCERTAIN)
    return _plan(members, 15.0, "nonlinear", law, scenario, flight_envelope(aircraft.parameters, model.point))


def _plan(
    members: int, degrees: float, plant: str, law: FlownLaw, scenario: Scenario, envelope: Envelope
) -> MonteCarlo:
    aircraft = Aircraft(default_parameters().values)
    point = find_operating_point(aircraft, level_flight(float(np.radians(degrees))))
    return MonteCarlo(members, 0, aircraft.parameters, "published", point, plant, law, scenario, envelope)
