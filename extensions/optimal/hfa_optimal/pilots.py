"""Policies as they are deployed, compiled for comparison with the best flight."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from controller.critic.critic import Critic
from hfa_flight.policies.deployment.policy import flown_deployment, sampled_scenario
from hfa_flight.policies.policy import Policy, function_policy
from hfa_flight.scenario import Scenario
from hfa_flight.simulation import CompiledLoop
from hfa_optimal.flights import Flights, SimulatedFlight


class Pilot(NamedTuple):
    """Policy that is compiled for simulation.

    name: name in reports
    loop: compiled closed loop
    """

    name: str
    loop: CompiledLoop

    def fly(self, flights: Flights, start: np.ndarray, seconds: float) -> SimulatedFlight:
        """Return the policy's flight from an initial condition.

        start: initial deviations z, (k,)
        seconds: duration of the flight, s
        """
        return flights.fly(self.loop, start, seconds)._replace(name=self.name)


def gain_pilot(flights: Flights, name: str, K: np.ndarray) -> Pilot:
    """Return the policy v = -K z, saturated at the limits of the inputs.

    name: name of the policy in reports
    K: gain, (m, k)
    """
    return Pilot(name, flights.compiled(flights.gain_policy(name, K)))


def critic_pilot(flights: Flights, name: str, critic: Critic) -> Pilot:
    """Return the policy of a critic, saturated at the limits of the inputs."""
    if critic.linear:
        return gain_pilot(flights, name, critic.K)
    policy = function_policy(name, critic.policy, flights.problem.point)
    return Pilot(name, flights.compiled(policy))


def deployment_pilot(flights: Flights, path: Path) -> Pilot:
    """Return the policy of a deployment file, with its sampling and delays.

    path: the deployment file
    """
    point = flights.problem.point
    policy = flown_deployment(path, point)
    start = np.zeros(len(flights.problem.model.states))
    scenario = Scenario(flights.tick, flights.step, flights.tick, initial=start)
    return deployed_pilot(
        flights, f"policy of {path}", policy, sampled_scenario(policy, scenario, point)
    )


def deployed_pilot(flights: Flights, name: str, policy: Policy, scenario: Scenario) -> Pilot:
    """Return a policy, compiled with the sampling and delays of a scenario.

    name: name of the policy in reports
    """
    return Pilot(name, flights.compiled(policy, scenario))
