"""What a Monte Carlo of flights visits: the law and the scenario that its members are draws of."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np

from controller.flight.actuators import LONGEST_STEP
from controller.flight.envelope import Envelope
from controller.flight.scenario import Scenario
from controller.monte_carlo.uncertain_plants import UncertainPlant, uncertain_plant
from controller.policy.commands import CommandedStates
from controller.policy.flown_law import FlownLaw
from controller.policy.signals import Signal
from hfa_model.parameters import Parameters
from hfa_model.variants import variant_named
from hfa_support.errors import BadInputError
from hfa_support.reporting.fields import Shown
from trim.point.operating_point import OperatingPoint


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(Shown):
    """N members, each a draw of one scenario. Two plans are equal when they give the same results.

    parameters, dynamics: the nominal aircraft, trimmed at `point`. plant: "nonlinear" or "linear". seed: with the
    number of a member it decides all that is random in it, so that members can be simulated anywhere in any order. A
    member's flight ends at the first step outside the envelope. BadInputError when a number is wrong, the flight does
    not begin inside its envelope, an error belongs to a parameter that is zero, or a signal has no formula.
    """

    members: int
    seed: int
    parameters: Parameters
    dynamics: str
    point: OperatingPoint
    plant: str
    law: FlownLaw
    scenario: Scenario
    envelope: Envelope

    def __post_init__(self) -> None:
        """Name what is wrong before the simulation."""
        for name, lowest in (("members", 1), ("seed", 0)):
            if not getattr(self, name) >= lowest:
                raise BadInputError(f"{name} is {getattr(self, name)}; it must be at least {lowest}")
        self.point.refuse_other(variant_named(self.dynamics))
        for name in ("reference", "disturbance", "noise"):
            if not isinstance(getattr(self.scenario, name), (Signal, CommandedStates)):
                raise BadInputError(f"the {name} of a Monte Carlo must be a Signal, whose formula says what it is")
        if self.scenario.samples is not None:
            raise BadInputError("the scenario of a Monte Carlo is drawn already; give the one that it was drawn from")
        if self.law.fastest * self.scenario.step > LONGEST_STEP:
            raise BadInputError(
                f"law {self.law.name} has a mode of {self.law.fastest:.4g} 1/s; at a step of {self.scenario.step:g} s "
                f"it must be below {LONGEST_STEP / self.scenario.step:g} 1/s: make the step shorter"
            )
        self.envelope.refuse_start(np.array(self.point.states) + self.scenario.initial)
        for name in self.scenario.uncertainty.errors:
            if getattr(self.parameters, name) == 0.0:
                raise BadInputError(f"{name} is 0, so that a relative error does nothing; leave it out")
        self.member(0)  # turbulence that cannot be made is refused here rather than in a worker
        uncertain_plant(self.plant, variant_named(self.dynamics), self.point)

    @property
    def uncertain_plant(self) -> UncertainPlant:
        """The plant with its parameters as an input."""
        return uncertain_plant(self.plant, variant_named(self.dynamics), self.point)

    def member(self, number: int) -> Scenario:
        """What happens in one member; turbulence is met at the trimmed speed."""
        return self.scenario.drawn(self.seed, number, self.point.states.speed)

    def parameters_of(self, member: Scenario) -> np.ndarray:
        """The parameters of a member, (18,)."""
        return np.array([value * member.errors.get(name, 1.0) for name, value in self.parameters._asdict().items()])

    def to_dict(self) -> dict[str, Any]:
        """JSON data that decides the results."""
        data = {
            "members": self.members,
            "seed": self.seed,
            "parameters": self.parameters._asdict(),
            "dynamics": self.dynamics,
            "states": self.point.states._asdict(),
            "inputs": self.point.inputs._asdict(),
            "plant": self.plant,
            "law": {"name": self.law.name, **self.law.identity},
            "scenario": self.scenario.to_dict(),
            "uncertainty": asdict(self.scenario.uncertainty),
            "envelope": self.envelope.to_dict(self.scenario.moving_air),
        }
        plain: dict[str, Any] = json.loads(json.dumps(data, default=lambda value: np.asarray(value).tolist()))
        return plain

    @cached_property
    def identity(self) -> str:
        """A hash of everything that decides the results, the order in which errors are drawn included."""
        return hashlib.sha256(json.dumps(self.to_dict()).encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MonteCarlo) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash(self.identity)
