"""Any policy, with the command of a sample changed where a rate would leave its limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario
from hfa_flight.plan.measured import Measured
from hfa_flight.plan.nearest_inputs import NearestInputs
from hfa_flight.plan.problem import FlightProblem, flight_problem
from hfa_flight.plan.scaled import ScaledProblem
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.policy import DeployedPolicy, flown_deployment
from hfa_flight.policies.policy import Measurements, Policy
from hfa_flight.policies.sampled_policy import SampledPolicy
from hfa_support.errors import BadInputError
from hfa_support.native.bound import BoundFunction
from trim.point.operating_point import OperatingPoint

#: Largest difference of a command and its nearest one that is rounding, in nominal values.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class KeptInside(Policy):
    """Policy u, replaced during a sample by the nearest inputs that keep the rates' limits.

    Where the next states of the model are within the limits, u is the policy's, to the last bit.

    policy: the policy
    problem: aircraft, trim and limits
    nearest: nearest inputs of a sample that keep the limits
    tick: duration of a sample, s
    delay: time from a sample until its command acts, s
    ticks: number of ticks of the flight in a sample
    changed: one entry, the number of samples of the last flight whose command was changed
    """

    predicts = False

    policy: Policy
    problem: FlightProblem
    nearest: NearestInputs
    tick: float
    delay: float
    ticks: int
    changed: list[int]

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the policy's inputs, or the nearest ones where they differ, (m,)."""
        size = self.policy.held.shape[1]
        of_policy, is_changed, u = ca.vertsplit(held, [0, size, size + 1, held.numel()])
        return ca.if_else(is_changed, u, self.policy.control(t, measurements, of_policy))

    def sampler(self) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the function (tick, measured) -> held inputs of the policy, whether they are
        replaced, and the nearest inputs.

        With a delay, a sampled policy too acts on the states when its command acts.
        """
        problem, nearest = self.problem, self.nearest
        own = self.policy
        step = self.tick / self.ticks
        policy_held = own.sampler() or (lambda k, _: own.held_inputs(k, k * step))
        command = BoundFunction(self._command())
        known = Measured(nearest.model, self.delay)
        trim = problem.point.x
        self.changed[0] = 0
        latest = self.held[0]

        def sample(tick: int, measured: np.ndarray) -> np.ndarray:
            """Return the held inputs of a tick, which change at a sample."""
            nonlocal latest
            if tick % self.ticks:
                return latest
            z = known.when_acting(problem.followed_of(trim + measured))
            acted = measured.copy()
            if self.delay:
                acted[problem.followed_places] = z * problem.sizes.states
            held = policy_held(tick, acted)
            (u,) = command.at(tick * step, measured, held)
            v = u[problem.moved] / problem.sizes.inputs
            inside = nearest(z, v)
            is_changed = bool(np.abs(inside - v).max() > _ROUNDING)
            known.command(inside)
            self.changed[0] += is_changed
            if is_changed:
                u = problem.inputs_of(inside) - problem.point.u
            latest = np.concatenate([held, [float(is_changed)], u])
            return latest

        return sample

    def _command(self) -> ca.Function:
        """Return the function (t, measured, held) -> command of the policy, (m,)."""
        problem = self.problem
        t, measured = ca.SX.sym("t"), ca.SX.sym("measured", len(problem.model.states))
        held = ca.SX.sym("held", self.policy.held.shape[1])
        states = measured[problem.model.state_places(problem.model.linear)]
        u = self.policy.control(t, Measurements(states, states), held)
        return ca.Function("command", [t, measured, held], [ca.densify(u)])

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy with the ticks and the delay of a scenario, and the scenario.

        A deployment's delay is added to that of the scenario, which acts after the nearest inputs.
        The policy itself has no delay then: its states are those when its command acts (`sampler`).

        Raises BadInputError (of the scenario) for a delay of a deployment that is not a whole
        number of samples.
        """
        policy = self.policy
        if isinstance(policy, DeployedPolicy):
            late = policy.deployed.deployment.delay + scenario.delay
            policy, scenario = policy.prompt().in_scenario(replace(scenario, delay=0.0))
            scenario = replace(scenario, delay=late)
        else:
            policy, scenario = policy.in_scenario(scenario)
        if isinstance(policy, SampledPolicy):
            policy = replace(policy, delay=0.0)
        nearest = NearestInputs(self.nearest.model.scaled, scenario.interval)
        held = np.zeros((1, policy.held.shape[1] + 1 + len(self.problem.model.inputs)))
        changed = replace(
            self,
            policy=policy,
            nearest=nearest,
            tick=scenario.interval,
            delay=scenario.delay,
            ticks=scenario.ticks_per_sample,
            held=held,
        )
        return changed, scenario

    def data(self, model: Model) -> dict[str, Any]:
        """Return the data of the policy, the kept states and the number of changed samples."""
        kept = {"kept_inside": list(self.nearest.states), "changed_samples": self.changed[0]}
        return {**self.policy.data(model), **kept}

    def notes(self) -> tuple[str, ...]:
        """Return the notes of the policy, and how often its command was changed."""
        names = ", ".join(self.nearest.states)
        return (
            *self.policy.notes(),
            f"--keep-inside ({names}): the command of {self.changed[0]} samples was changed.",
        )


def keep_inside(
    policy: Policy | Deployment,
    model: Model,
    point: OperatingPoint,
    *,
    limits: Mapping[str, Any] | None = None,
) -> KeptInside:
    """Return a policy whose command is changed for a sample where a rate would leave its limits.

    The change is the least, in fractions of the inputs' ranges, after which the model's next states
    are within 96 % of the distances from trim to limits. Only states that the inputs can move by a
    tenth of their range in one sample are kept, such as a pitch rate. Wrong parameters and
    disturbances are not known. In a flight with a delay, the states are predicted over the
    commands under way, for a policy that is computed once a sample too.

    policy: a policy of `hfa.fly`, such as `hfa.predictive(...)`, or an `hfa.Deployment`
    model, point: the aircraft and its trim
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError if the inputs reach no limit in one sample.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, dihedral=0.2)
    >>> law = hfa.state_dependent(model, point)
    >>> kept = hfa.keep_inside(law, model, point, limits={"pitch_rate": (-0.05, 0.05)})
    >>> start = {"alpha": 0.05}
    >>> flights = [hfa.fly(model, point, each, 0.2, initial=start) for each in (law, kept)]
    >>> [bool(abs(flight.states[:, 4]).max() <= 0.05) for flight in flights]
    [False, True]
    """
    if isinstance(policy, Deployment):
        policy = flown_deployment(policy, point)
    return kept_inside(policy, flight_problem(model, point, limits=limits))


def kept_inside(policy: Policy, problem: FlightProblem, tick: float = 0.01) -> KeptInside:
    """Return the policy of `keep_inside` for a problem, and samples of a flight, s."""
    nearest = NearestInputs(ScaledProblem(problem), tick)
    if not nearest.states:
        raise BadInputError(
            f"in {tick:g} s the inputs move no limited state by a tenth of its range; remove "
            "keep-inside"
        )
    held = np.zeros((1, policy.held.shape[1] + 1 + len(problem.model.inputs)))
    return KeptInside(
        f"{policy.name}, kept inside",
        policy,
        problem,
        nearest,
        tick,
        delay=0.0,
        ticks=1,
        changed=[0],
        held=held,
        identity={**policy.identity, "keeps": list(nearest.states)},
    )
