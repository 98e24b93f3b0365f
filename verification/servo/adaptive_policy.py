"""Adaptive laws as policies: what those of both orders share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from controller.design.design_file import load_design
from controller.design.design_model import design_model
from controller.design.dihedral_table import DihedralTable
from controller.policy.commands import CommandSteps
from controller.policy.policies import FlownLaw, Seen, Unvaried
from controller.policy.servo_policy import MeasuredOutputs
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_STATES
from trim.linear.linear_model import level_model
from trim.point.operating_point import OperatingPoint
from verification.servo.adaptive_parts import MemoryParts
from verification.servo.reference_model import RATE, REGULATED, ReferenceModel, reference_model

_DIHEDRAL = LINEAR_STATES.index("dihedral")
_TABLED = ("A", "B", "K", "L", "S", "R_inverse", "squared_up")


@dataclass(frozen=True, eq=False)
class AdaptivePolicy(Unvaried, ABC):
    """A law with a reference model, tabled over the measured dihedral.

    outputs: pitch rate and what is regulated. dihedral: of the trim in which the flight begins, rad. angles: (N,), rad,
    of `models`. inputs: names of u.
    """

    commands: CommandSteps
    outputs: MeasuredOutputs
    dihedral: float
    angles: np.ndarray
    models: Sequence[ReferenceModel]
    inputs: tuple[str, ...]

    @abstractmethod
    def law(self, memory: MemoryParts, tables: Sequence[ca.SX], measured: ca.SX, command: tuple[ca.SX, ca.SX]) -> ca.SX:
        """Take the parts of the memory and set their rates; u, (m,).

        tables: A, B, K, L, S, R⁻¹ and the squared-up B. command: r and r'.
        """

    @property
    def memory_size(self) -> int:
        """Reference model, filters and adaptive parameters."""
        return len(self.start)

    @cached_property
    def start(self) -> np.ndarray:
        """The nominal parameters, everything else 0."""
        memory, nothing = MemoryParts(), ca.SX.zeros(len(self.inputs))
        self.law(memory, self._table.at(ca.SX(self.dihedral)), ca.SX.zeros(len(self.outputs.names)), (nothing, nothing))
        return memory.start

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """u of the inputs, 0 of the others."""
        chosen = np.array([[float(name == one) for one in self.inputs] for name in INPUTS])
        return ca.mtimes(ca.DM(chosen), self._flown(t, seen, memory)[0])

    def memory_rate(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX, applied: ca.SX) -> ca.SX:
        """What `law` sets."""
        return self._flown(t, seen, memory)[1]

    def _flown(self, t: ca.SX, seen: Seen, memory: ca.SX) -> tuple[ca.SX, ca.SX]:
        parts, command = MemoryParts(memory), (self.commands.at(t), self.commands.rate(t))
        tables = self._table.at(self.dihedral + seen.states[_DIHEDRAL])
        u = self.law(parts, tables, self.outputs.at(seen), command)
        return u, parts.rate

    @cached_property
    def _table(self) -> DihedralTable:
        return DihedralTable(self.angles, [np.array([getattr(each, name) for each in self.models]) for name in _TABLED])


def adaptive_law(
    kind: type[AdaptivePolicy],
    order: int,
    aircraft: Aircraft,
    point: OperatingPoint,
    commands: CommandSteps,
    angles: np.ndarray,
) -> FlownLaw:
    """The law of a kind from its nominal parameters. order: of the actuators. angles: of the tables, rad."""
    design = load_design(f"simvfa-{order}")
    models = [
        reference_model(design_model(aircraft, level_model(aircraft, angle), design)) for angle in angles.tolist()
    ]
    outputs = MeasuredOutputs(aircraft, point, (RATE, *REGULATED))
    policy = kind(commands, outputs, point.states.dihedral, angles, models, design.inputs)
    fastest = max(float(np.abs(np.linalg.eigvals(each.A - each.L @ each.C)).max()) for each in models)
    identity = {
        "law": kind.__name__,
        "order": order,
        "angles": angles,
        "times": commands.times,
        "values": commands.values,
    }
    name = f"simvfa-{order} adaptive"
    return FlownLaw(name, policy, np.zeros((1, 0)), policy.start, identity, fastest=fastest)
