"""Deployment files as policies of `hfa fly`, sampled and held."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.held_step import parts_of_a_sample
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.sensors import at_trim
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.sampled_loop import EquilibriumSearch, chain_of_loop
from hfa_flight.policies.policy import Policy
from hfa_support.errors import BadInputError
from hfa_support.native.bound import BoundFunction
from hfa_support.reporting.results import storable
from trim.linear.delays import in_samples
from trim.point.operating_point import OperatingPoint

#: Longest step of a flight, s, and of one in moving air.
_LONGEST = 0.02
_FINE = 0.001
#: Largest number of ticks in a sample time.
_PARTS = 1000


@dataclass(frozen=True, eq=False, repr=False)
class DeployedPolicy(Policy):
    """Policy of `hfa fly` that holds the commanded inputs of a deployment between its samples.

    deployed: the policy on its aircraft.
    point: trim from which the deviations are measured.
    """

    deployed: Deployed
    point: OperatingPoint

    @property
    def sensors(self) -> tuple[str, ...]:
        """States and outputs that the deployment sees, or () for all states."""
        sensed = self.deployed.sensed
        return (*self.point.model.states, *sensed) if sensed else ()

    @property
    def tick(self) -> float:
        """Greatest common divisor of sample time and delay, s.

        Raises BadInputError unless the delay is a whole number of sample times divided by a whole
        number of at most `_PARTS`.
        """
        deployment = self.deployed.deployment
        delay = in_samples(deployment.delay, deployment.dt)
        samples = delay.whole + delay.rest / deployment.dt
        # The delay is p/q of a sample time, so both are whole numbers of ticks dt/q.
        ratio = Fraction(samples).limit_denominator(_PARTS)
        if not math.isclose(samples, float(ratio), rel_tol=1e-9, abs_tol=1e-9):
            raise BadInputError(
                f"{deployment.origin}: timing.delay is {deployment.delay:.12g} s, which a "
                f"simulation cannot divide into steps; give {float(ratio) * deployment.dt:.12g} s"
            )
        return deployment.dt / ratio.denominator

    def sampler(self, initial: np.ndarray | None = None) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the function (tick, measured) -> inputs as deviations from trim, (m,).

        It is called at each tick, with the measured deviations from trim of what it sees.
        """
        deployment = self.deployed.deployment
        ticks_per_sample = round(deployment.dt / self.tick)
        delayed_ticks = in_samples(deployment.delay, self.tick).whole
        waiting: list[tuple[int, np.ndarray]] = []  # tick from which a command acts, and command
        acting = np.zeros(len(self.point.u))
        commanded = self.commander()

        def sample(tick: int, measured: np.ndarray) -> np.ndarray:
            nonlocal acting
            if tick % ticks_per_sample == 0:
                waiting.append((tick + delayed_ticks, commanded(measured)))
            while waiting and waiting[0][0] <= tick:
                acting = waiting.pop(0)[1]
            return acting

        return sample

    def commander(self) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function measured -> command as deviations from trim, (m,).

        It is called at each sample, with the measured deviations from trim of what it sees.
        """
        deployment = self.deployed.deployment
        trim = self.deployed.trim_vector(self.point)
        seen = at_trim(self.point, (*self.point.model.states, *self.deployed.sensed))
        inputs = self.point.u
        # commands that may act at the next sample or later, the oldest first
        under_way = [inputs] * (in_samples(deployment.delay, deployment.dt).whole + 1)
        commanded = BoundFunction(self.deployed.command)

        def command(measured: np.ndarray) -> np.ndarray:
            before = under_way.pop(0)  # the input just before the sample
            (U,) = commanded.at(seen + measured, before, trim)
            under_way.append(np.array(U))
            return np.asarray(U - inputs)

        return command

    def prompt(self) -> Self:
        """Return the policy without the delay of its deployment."""
        deployment = self.deployed.deployment
        timing = {**deployment.timing, "delay": 0.0}
        return replace(
            self, deployed=replace(self.deployed, deployment=replace(deployment, timing=timing))
        )

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy with the sensors of a scenario, and the scenario with ticks that divide
        samples and delay.

        A step is at most `_LONGEST`, and in moving air at most `_FINE`. Raises
        BadInputError for a delay that is not a fraction of the sample time.
        """
        sensors = self.deployed.sensors_in_air(scenario.sensors or scenario.uncertainty.noise)
        dt = self.deployed.deployment.dt
        longest = _FINE if scenario.moving_air else _LONGEST
        longest = min(dt / parts_of_a_sample([self.point], dt), longest)
        sensing = replace(self, deployed=self.deployed.sensing(sensors))
        return sensing, scenario.with_tick(self.tick, longest, dt)

    def sampled_modes(self) -> np.ndarray | None:
        """Return the eigenvalues of the loop at the equilibrium near the trim, 1/s, or None."""
        timing = self.deployed.deployment
        equilibrium = EquilibriumSearch(self.deployed, self.point).equilibrium()
        if equilibrium is None:
            return None
        return chain_of_loop(equilibrium.nominal, timing.dt, timing.delay).modes

    def notes(self) -> tuple[str, ...]:
        """Return contradictions between the policy's files, and what it does not use of them."""
        return self.deployed.deployment.actor.declared.notes

    def data(self, model: Model) -> dict[str, Any]:
        """Return the policy's name, deployment file and network, for the JSON output."""
        deployment = self.deployed.deployment
        return {
            "name": self.name,
            "deployment_file": deployment.origin,
            "network": deployment.actor.chain,
            "declared": storable(deployment.actor.declared),
        }


def flown_deployment(given: Deployment | Path, point: OperatingPoint) -> DeployedPolicy:
    """Return the policy of a deployment, or of the deployment file with this path, about a trim.

    Raises the errors of `Deployment.load`, and BadInputError if the deployment does not fit the
    aircraft, or if an observation, the policy or a map is not finite at the trim.
    """
    deployed = Deployed(Deployment.of(given), point.model)
    deployed.refuse_undefined_at([point])
    name = "deployment" if isinstance(given, Deployment) else f"of {given}"
    held = np.zeros((1, len(point.model.inputs)))  # the sampler returns them in flight
    return DeployedPolicy(name, deployed, point, held=held)
