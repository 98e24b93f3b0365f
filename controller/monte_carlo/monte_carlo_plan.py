"""What a Monte Carlo of flights visits: the flight that all members share, and what differs from member to member."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from controller.flight.critic_policy import CriticPolicy
from controller.flight.gusts import Dryden
from controller.flight.policies import GainPolicy, Policy, gain_constants
from controller.flight.signals import Signal, zero
from controller.flight.times import Timed
from controller.monte_carlo.uncertain_plants import UncertainPlant, uncertain_plant
from hfa_model.parameters import Parameters
from hfa_model.support.errors import BadInputError
from hfa_model.variants import variant_named
from hfa_model.vectors import INPUTS, LINEAR_STATES, STATES
from trim.point.condition import describe
from trim.point.operating_point import OperatingPoint

_N = len(LINEAR_STATES)


@dataclass(frozen=True, eq=False)
class FlownLaw:
    """A policy that all members fly, with its constants p and its memory at the start.

    identity: JSON data that decides what it does.
    """

    name: str
    policy: Policy
    constants: np.ndarray
    memory: np.ndarray
    identity: Mapping[str, Any]


def gain_law(name: str, K: np.ndarray) -> FlownLaw:
    """u = -K z with one gain for the whole flight. K: (5, 6), or BadInputError."""
    shape = (len(INPUTS), _N)
    if np.shape(K) != shape or not np.all(np.isfinite(K)):
        raise BadInputError(f"the gain has shape {np.shape(K)}; give {shape[0]} x {shape[1]} finite numbers")
    return FlownLaw(name, GainPolicy(zero(len(INPUTS))), gain_constants(K), np.zeros(0), {"K": np.asarray(K).tolist()})


def critic_law(name: str, policy: CriticPolicy) -> FlownLaw:
    """Eq. (46) learning in flight, from the initial weights of its law."""
    plain = {key: _plain(value) for key, value in policy.law.fingerprint().items()}
    identity = plain | {"forcing": _signal_data(policy.forcing)}
    return FlownLaw(name, policy, np.ones(1), policy.law.start()["weights"], identity)


@dataclass(frozen=True, eq=False)
class Course(Timed):
    """The flight that all members share.

    duration, step, tick: s; noise and turbulence change once a tick, which holds a whole number of steps. initial:
    (7,), deviation from trim. reference, disturbance: (6,). lowest, highest: (7,), absolute states; a member's flight
    ends at the first step outside. BadInputError when the times do not fit each other or are too long.
    """

    lowest: np.ndarray
    highest: np.ndarray
    duration: float = 20.0
    step: float = 0.001
    tick: float = 0.01
    initial: np.ndarray = field(default_factory=lambda: np.zeros(len(STATES)))
    reference: Signal = field(default_factory=lambda: zero(_N))
    disturbance: Signal = field(default_factory=lambda: zero(_N))

    def __post_init__(self) -> None:
        """Refuse times that do not fit."""
        self.check_times()

    def to_dict(self) -> dict[str, Any]:
        """JSON data that decides the flight."""
        return {
            "lowest": np.asarray(self.lowest).tolist(),
            "highest": np.asarray(self.highest).tolist(),
            "duration": self.duration,
            "step": self.step,
            "tick": self.tick,
            "initial": np.asarray(self.initial).tolist(),
            "reference": _signal_data(self.reference),
            "disturbance": _signal_data(self.disturbance),
        }


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What differs from member to member; nothing unless given.

    errors: parameter -> relative standard deviation of the flown aircraft's about the nominal value. noise: state of
    the linear model -> standard deviation of what its sensor adds, drawn anew every tick and held. turbulence:
    (intensity, ft/s, scale, ft) of Dryden turbulence, or None. BadInputError when a name or a number is wrong.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    turbulence: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Name what is wrong before anything flies."""
        for what, given, names in (
            ("parameter", self.errors, Parameters._fields),
            ("noise of state", self.noise, LINEAR_STATES),
        ):
            for name, value in given.items():
                if name not in names:
                    raise BadInputError(f"unknown {what} {name!r}; choose from {', '.join(names)}")
                if not (np.isfinite(value) and value >= 0.0):
                    raise BadInputError(f"the standard deviation of {name} is {value}; it must not be negative")
        for value in self.turbulence or ():
            if not (np.isfinite(value) and value > 0.0):
                raise BadInputError(f"the turbulence has {value}; intensity and scale must be positive numbers")


@dataclass(frozen=True, eq=False)
class MonteCarlo:
    """N members of one flight. Two plans are equal when they give the same results.

    parameters, dynamics: the nominal aircraft, trimmed at `point`. plant: "nonlinear" or "linear". seed: with the
    number of a member it decides all that is random in it, so that members can be flown anywhere in any order.
    BadInputError when a number is wrong, the flight does not begin inside its envelope, or an error belongs to
    a parameter that is zero.
    """

    members: int
    seed: int
    parameters: Parameters
    dynamics: str
    point: OperatingPoint
    plant: str
    law: FlownLaw
    course: Course
    uncertainty: Uncertainty

    def __post_init__(self) -> None:
        """Name what is wrong before anything flies."""
        for name, lowest in (("members", 1), ("seed", 0)):
            if getattr(self, name) < lowest:
                raise BadInputError(f"{name} is {getattr(self, name)}; it must be at least {lowest}")
        start = np.array(self.point.states) + self.course.initial
        for name, value, low, high in zip(STATES, start, self.course.lowest, self.course.highest, strict=True):
            if not low <= value <= high:
                found, begin, end = (describe(name, number) for number in (value, low, high))
                raise BadInputError(f"the flight begins with {name} {found}, outside {begin} to {end}")
        for name in self.uncertainty.errors:
            if getattr(self.parameters, name) == 0.0:
                raise BadInputError(f"{name} is 0, so that a relative error does nothing; leave it out")
        if self.uncertainty.turbulence is not None:  # refused here rather than in a worker
            Dryden(*self.uncertainty.turbulence, self.point.states.speed, self.course.tick, self.course.ticks, 0)
        uncertain_plant(self.plant, variant_named(self.dynamics), self.point)

    @property
    def uncertain_plant(self) -> UncertainPlant:
        """The plant with its parameters as an input."""
        return uncertain_plant(self.plant, variant_named(self.dynamics), self.point)

    def to_dict(self) -> dict[str, Any]:
        """JSON data that decides the results."""
        return {
            "members": self.members,
            "seed": self.seed,
            "parameters": self.parameters._asdict(),
            "dynamics": self.dynamics,
            "states": self.point.states._asdict(),
            "inputs": self.point.inputs._asdict(),
            "plant": self.plant,
            "law": {"name": self.law.name, **self.law.identity},
            "course": self.course.to_dict(),
            "uncertainty": asdict(self.uncertainty),
        }

    @cached_property
    def identity(self) -> str:
        """A hash of everything that decides the results."""
        return hashlib.sha256(json.dumps(self.to_dict(), sort_keys=True).encode()).hexdigest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MonteCarlo) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash(self.identity)


def _signal_data(signal: Signal) -> dict[str, Any]:
    waves = [[wave.frequency, wave.sine.tolist(), wave.cosine.tolist()] for wave in signal.harmonics]
    return {"constant": signal.constant.tolist(), "slope": signal.slope.tolist(), "harmonics": waves}


def _plain(value: Any) -> Any:
    return np.asarray(value).tolist()
