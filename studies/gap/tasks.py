"""Aircraft of the study, and the rule that derives the deployment of a policy from the aircraft.

All states of the linear model are observed, scaled by the half-widths of the initial-condition box.
Each input can move in both directions by the distance from the trim to its nearer limit. The cost
follows Bryson's rule, with weight 1 for a state at its half-width and an input at this distance. No
setting is chosen for a single aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import hfa
from hfa_flight.initial_box import start_box
from trim.point.operating_point import OperatingPoint

#: Sample time, s.
SAMPLE_TIME = 0.05


@dataclass(frozen=True)
class Task:
    """An aircraft at a trim.

    name: name in the table
    aircraft: value of the option `--aircraft`, or None for the flexible aircraft
    hold: values imposed on the trim, in the units of the model
    """

    name: str
    aircraft: str | None
    hold: Mapping[str, float] = field(default_factory=dict)

    def point(self) -> OperatingPoint:
        """Return the trim of the aircraft at the values in `hold`."""
        model = hfa.aircraft() if self.aircraft is None else hfa.load_model(self.aircraft)
        return hfa.trim(model, hold=dict(self.hold))


TASKS = (
    Task("pendulum", "examples/pendulum.py:PENDULUM"),
    Task("GTM 48 m/s", "examples/gtm.py:GTM", {"speed": 48.0}),
    Task("HFA 10 deg", None, {"dihedral": float(np.radians(10.0))}),
    Task("Navion", "examples/navion.py:NAVION"),
    Task("F-16 10,000 ft", "examples/f16.py:F16", {"speed": 502.0, "altitude": 10_000.0}),
    Task("c172p 100 kt", "jsbsim:c172p", {"kcas": 100.0, "altitude": 3000.0}),
    Task("737 250 kt", "jsbsim:737", {"kcas": 250.0, "altitude": 15_000.0}),
)


def deployment_of(point: OperatingPoint, policy: Path | None = None) -> hfa.Deployment:
    """Return the deployment of a policy about a trim.

    policy: zip of Stable-Baselines3, trained without a normalizer of observations, or None before
      the training
    """
    reaches = _reaches(point)
    action = {
        name: {"box": [-1, 1], "map": f"trim + {reach!r} * a"} for name, reach in reaches.items()
    }
    Q, R = cost_of(point)
    return hfa.Deployment(
        policy={} if policy is None else {"file": str(policy), "normalizer": "none"},
        observation={name: {"scale": width} for name, width in _widths(point).items()},
        action=action,
        timing={"dt": SAMPLE_TIME},
        cost={"Q": Q, "R": R},
    )


def cost_of(point: OperatingPoint) -> tuple[dict[str, float], dict[str, float]]:
    """Return the diagonals of Q and R by Bryson's rule, each as weights by name of the state or
    input.
    """
    Q = {name: width**-2 for name, width in _widths(point).items()}
    R = {name: reach**-2 for name, reach in _reaches(point).items()}
    return Q, R


def _widths(point: OperatingPoint) -> dict[str, float]:
    """Return linear state -> half-width of the initial-condition box."""
    model = point.model
    return dict(zip(model.linear, start_box(model, point).tolist(), strict=True))


def _reaches(point: OperatingPoint) -> dict[str, float]:
    """Return the distance of each input from the trim to its nearer limit, by name."""
    reaches = {}
    for name, signal in point.model.inputs.items():
        value = float(getattr(point.inputs, name))
        reaches[name] = min(value - signal.min, signal.max - value)
    return reaches
