"""A gain scheduled over the dihedral: trims and gains on a grid, flown through a slow change of dihedral."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from controller.design.dihedral_table import interpolated
from controller.policy.policies import Memoryless, Seen, Unvaried
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATES, Quantity
from hfa_support.errors import BadInputError, refuse_unless_positive
from trim.point.operating_point import OperatingPoint

_N, _M = len(LINEAR_STATES), len(INPUTS)
_DIHEDRAL, _DIHEDRAL_RATE = LINEAR_STATES.index("dihedral"), LINEAR_STATES.index("dihedral_rate")


@dataclass(frozen=True, eq=False)
class Schedule:
    """Trims X0(η), U0(η) and gains K(η) on a grid of dihedrals, linear in between and constant beyond its ends.

    dihedrals: (G,), rad, increasing, G >= 2. states: (G, 7). inputs: (G, 5). gains: (G, 5, 6). BadInputError when
    a shape, the order or a number is wrong.
    """

    dihedrals: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    gains: np.ndarray

    def __post_init__(self) -> None:
        """Check the grid once."""
        count = len(self.dihedrals)
        shapes = {"states": (count, len(STATES)), "inputs": (count, _M), "gains": (count, _M, _N)}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise BadInputError(f"the schedule's {name} are {np.shape(getattr(self, name))}; they must be {shape}")
        for name in ("dihedrals", *shapes):
            if not np.all(np.isfinite(getattr(self, name))):
                raise BadInputError(f"the schedule's {name} hold a number that is not finite")
        if count < 2 or np.any(np.diff(self.dihedrals) <= 0.0):
            raise BadInputError("a schedule needs at least two dihedrals, in increasing order")

    @classmethod
    def of(cls, points: tuple[OperatingPoint, ...], gains: tuple[np.ndarray, ...]) -> Schedule:
        """The schedule of trims and the gain of each."""
        states = np.array([point.states for point in points])
        inputs = np.array([point.inputs for point in points])
        return cls(states[:, STATES.index("dihedral")], states, inputs, np.array(gains))

    def states_at(self, dihedral: Quantity) -> ca.SX | ca.DM:
        """X0(η), (7,), as a CasADi column."""
        return self._at(self.states, dihedral)

    def inputs_at(self, dihedral: Quantity) -> ca.SX | ca.DM:
        """U0(η), (5,), as a CasADi column."""
        return self._at(self.inputs, dihedral)

    def gain_at(self, dihedral: Quantity) -> ca.SX | ca.DM:
        """K(η), (5, 6), as a CasADi matrix."""
        flat = self.gains.transpose(0, 2, 1).reshape(len(self.gains), _M * _N)
        return ca.reshape(self._at(flat, dihedral), _M, _N)

    def _at(self, table: np.ndarray, dihedral: Quantity) -> ca.SX | ca.DM:
        return interpolated(self.dihedrals, table, dihedral)


@dataclass(frozen=True)
class DihedralChange:
    """η_d(t) = start + (end - start) (10 τ³ - 15 τ⁴ + 6 τ⁵), τ = (t - begin)/duration held in [0, 1]; rad, s.

    Rate and acceleration are continuous and 0 at both ends. BadInputError when the duration is not positive.
    """

    start: float
    end: float
    begin: float
    duration: float

    def __post_init__(self) -> None:
        """A change takes time."""
        refuse_unless_positive("the time of the change of dihedral", self.duration, " s")

    def at(self, t: Quantity) -> ca.SX:
        """η_d(t)."""
        tau = self._progress(t)
        return self.start + (self.end - self.start) * tau**3 * (10 - 15 * tau + 6 * tau**2)

    def rate(self, t: Quantity) -> ca.SX:
        """η_d'(t)."""
        tau = self._progress(t)
        return (self.end - self.start) / self.duration * 30 * tau**2 * (1 - tau) ** 2

    def _progress(self, t: Quantity) -> ca.SX:
        return ca.fmin(ca.fmax((t - self.begin) / self.duration, 0.0), 1.0)


@dataclass(frozen=True, eq=False)
class ScheduledReference:
    """x_d(t) = X0(η_d(t)) - X_base with η' = η_d'(t): the trims along the change, (6,), of the six states."""

    size = _N

    schedule: Schedule
    change: DihedralChange
    base: OperatingPoint

    def at(self, t: Quantity) -> ca.SX:
        """x_d(t); a CasADi column."""
        deviation = self.schedule.states_at(self.change.at(t)) - ca.DM(np.array(self.base.states))
        rows = [deviation[row] for row in LINEAR_ROWS]
        rows[_DIHEDRAL_RATE] = self.change.rate(t)
        return ca.vertcat(*rows)


@dataclass(frozen=True, eq=False)
class ScheduledPolicy(Memoryless, Unvaried):
    """u = U0(η_d(t)) - U_base - K(η) z, with η = η_base + x_d,η + z_η the measured dihedral.

    The trims follow the commanded dihedral and the gain the measured one. So, linearized about a trim, the policy
    is u = -K z with the K of that trim: U0 of the measured dihedral would add the gain ∂U0/∂η, and z is 0 at a
    trim, so that ∂K/∂η adds nothing.
    """

    reference: ScheduledReference

    def control(self, t: ca.SX, seen: Seen, memory: ca.SX, p: ca.SX) -> ca.SX:
        """U0 - U_base - K z."""
        schedule, base = self.reference.schedule, self.reference.base
        measured = base.states.dihedral + self.reference.at(t)[_DIHEDRAL] + seen.error[_DIHEDRAL]
        trimmed = schedule.inputs_at(self.reference.change.at(t)) - ca.DM(np.array(base.inputs))
        return trimmed - ca.mtimes(schedule.gain_at(measured), seen.error)
