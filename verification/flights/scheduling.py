"""A schedule of certified gains over the dihedral, a flight through a slow change of dihedral, and the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.envelope import Envelope
from controller.flight.nonlinear_flight import NonlinearFlight, fly_law
from controller.flight.plants import NonlinearPlant
from controller.flight.scenario import Scenario, with_errors
from controller.game.zero_sum import published_game
from controller.policy.gain_table import GainTable
from controller.policy.learned_gain import learned_value
from controller.policy.policies import FlownLaw, Memoryless, Seen, Unvaried
from controller.riccati.balancing import spectrum
from controller.riccati.gare import solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import INPUTS, LINEAR_ROWS, LINEAR_STATES, STATES, UNITS, Quantity
from hfa_support.errors import BadInputError, refuse_unless_positive
from hfa_support.linear_table import LinearTable
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import TrimCondition, level_flight
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point

#: Flight before and after a change of dihedral, s.
LEAD, REST = 5.0, 15.0
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

    def states_at(self, dihedral: ca.SX) -> ca.SX:
        """X0(η), (7,)."""
        return LinearTable(self.dihedrals, self.states).expression(dihedral)

    def inputs_at(self, dihedral: ca.SX) -> ca.SX:
        """U0(η), (5,)."""
        return LinearTable(self.dihedrals, self.inputs).expression(dihedral)

    def gain_at(self, dihedral: ca.SX) -> ca.SX:
        """K(η), (5, 6)."""
        flat = LinearTable(self.dihedrals, self.gains.transpose(0, 2, 1)).expression(dihedral)
        return ca.reshape(flat, _M, _N)


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


@dataclass(frozen=True, eq=False)
class GridPoint:
    """One gain: where, K (5, 6), the abscissa of A - B K, 1/s; of a law also its relative distance from the exact one,
    the abscissa of A - S P, 1/s, and how many certificates hold."""

    point: OperatingPoint
    gain: np.ndarray
    control_abscissa: float
    distance: float | None = None
    game_abscissa: float | None = None
    certificates: int | None = None


@dataclass(frozen=True, eq=False, repr=False)
class CertifiedSchedule(Reported):
    """A schedule, the points that it is made of, certified unless they came from a file, and the largest abscissa of
    A - B K halfway between them, with the interpolated K, 1/s."""

    schedule: Schedule
    grid: tuple[GridPoint, ...]
    between: float

    def report(self) -> Report:
        """The grid, and what holds between its points."""
        return Report("Schedule of certified gains", (self.block(),))

    def block(self) -> Part:
        """One row a grid point, and what holds between them."""
        rows = [
            (
                f"{in_degrees(row.point.states.dihedral):g}",
                f"{row.control_abscissa:.4f}",
                "-" if row.game_abscissa is None else f"{row.game_abscissa:.4f}",
                "-" if row.distance is None else f"{row.distance:.1e}" if row.distance else "0",
                "-" if row.certificates is None else f"{row.certificates} hold",
            )
            for row in self.grid
        ]
        header = ("dihedral deg", "abscissa A-BK 1/s", "abscissa A-SP 1/s", "K off the exact", "certificates")
        between = f"halfway between the points, interpolated gain: largest abscissa of A-BK {self.between:.4f} 1/s"
        return (Table(header, rows), between)

    def at(self, dihedral: float) -> GridPoint:
        """The grid point at a dihedral, rad; BadInputError when there is none."""
        for row in self.grid:
            if abs(row.point.states.dihedral - dihedral) <= 1e-9:
                return row
        raise BadInputError(f"the schedule has no grid point at {np.degrees(dihedral):g} deg; begin at one that it has")


def schedule_report(result: NonlinearFlight, certified: CertifiedSchedule, change: DihedralChange, law: str) -> Report:
    """The report of the flight with that of the schedule, whose gains `law` has made."""
    flown = result.report()
    words = f", to {in_degrees(change.end):g} deg over {change.duration:g} s, law {law}, scheduled"
    grid = {
        "law": law,
        "dihedrals": certified.schedule.dihedrals,
        "gains": certified.schedule.gains,
        "state_units": [UNITS[name] for name in LINEAR_STATES],
        "control_abscissae": [row.control_abscissa for row in certified.grid],
        "game_abscissae": [row.game_abscissa for row in certified.grid],
        "distances_from_exact": [row.distance for row in certified.grid],
        "largest_abscissa_between": certified.between,
    }
    return replace(
        flown,
        title=result.title(words),
        parts=(*flown.parts, certified.block()),
        data={**flown.data, "schedule": grid},
    )


def change_over(start: float, end: float, duration: float) -> DihedralChange:
    """A change from start to end, rad, that begins after `LEAD` seconds. BadInputError when there is none."""
    if start == end:
        raise BadInputError(f"the dihedral begins and ends at {np.degrees(start):g} deg; give two different ones")
    return DihedralChange(start, end, LEAD, duration)


def grid_of(change: DihedralChange, points: int) -> np.ndarray:
    """Equally spaced dihedrals that the change passes, both ends included, increasing, rad."""
    return np.linspace(min(change.start, change.end), max(change.start, change.end), points)


def certified_schedule(
    aircraft: Aircraft,
    dihedrals: np.ndarray,
    *,
    law: str = "exact",
    seed: int = 0,
    game: Mapping[str, Any] | None = None,
    settings: Mapping[str, Any] | None = None,
    gains: GainTable | None = None,
    condition: Callable[[float], TrimCondition] = level_flight,
    progress: Progress | None = None,
) -> CertifiedSchedule:
    """Trim, linearize and solve or learn at every dihedral, rad; every gain must be certified.

    law: "exact", or a learning law. game: changes of the published game (Q, R, delta). settings: of the law.
    gains: in place of a law, as they are, certified or not. condition: dihedral -> trim.
    Raises NoSolutionError at the first dihedral without a trim or without a certified gain.
    """
    if np.ndim(dihedrals) != 1 or len(dihedrals) < 2:
        raise BadInputError("a schedule needs at least two dihedrals, in increasing order")
    grid = []
    for dihedral in told(dihedrals.tolist(), progress):
        model = linearize(aircraft, find_operating_point(aircraft, condition(dihedral)))
        if gains is None:
            grid.append(_certified(model, law, seed, game or {}, settings or {}))
        else:
            gain = gains.at(dihedral)
            grid.append(GridPoint(model.point, gain, spectrum(model.A - model.B @ gain).abscissa))
    schedule = Schedule.of(tuple(row.point for row in grid), tuple(row.gain for row in grid))
    return CertifiedSchedule(schedule, tuple(grid), _between(aircraft, schedule, condition))


def _certified(
    model: LinearModel, law: str, seed: int, changes: Mapping[str, Any], settings: Mapping[str, Any]
) -> GridPoint:
    game = published_game(model.A, model.B, **changes)
    exact = solve_game(game)
    P, gain, certificates = exact.P, exact.K, len(exact.certificate.checks)
    if law != "exact":
        learned = learned_value(game, law, seed, **settings)
        P, gain, certificates = learned.P, learned.K, len(learned.certificates)
    return GridPoint(
        point=model.point,
        gain=gain,
        distance=float(np.linalg.norm(gain - exact.K) / np.linalg.norm(exact.K)),
        control_abscissa=spectrum(game.A - game.B @ gain).abscissa,
        game_abscissa=spectrum(game.A - game.S @ P).abscissa,
        certificates=certificates,
    )


def _between(aircraft: Aircraft, schedule: Schedule, condition: Callable[[float], TrimCondition]) -> float:
    worst = -np.inf
    for dihedral in ((schedule.dihedrals[:-1] + schedule.dihedrals[1:]) / 2).tolist():
        model = linearize(aircraft, find_operating_point(aircraft, condition(dihedral)))
        gain = LinearTable(schedule.dihedrals, schedule.gains).at(dihedral)
        worst = max(worst, spectrum(model.A - model.B @ gain).abscissa)
    return worst


def fly_schedule(
    aircraft: Aircraft,
    certified: CertifiedSchedule,
    change: DihedralChange,
    scenario: Scenario,
    envelope: Envelope,
    *,
    progress: Progress | None = None,
) -> NonlinearFlight:
    """The nonlinear aircraft along the trims of a change of dihedral; the scenario's own reference is replaced.

    The change begins at a grid point, whose trim is the one that deviations count from.
    """
    begin = certified.at(change.start).point
    reference = ScheduledReference(certified.schedule, change, begin)
    plant = NonlinearPlant(with_errors(aircraft, scenario), begin)
    return fly_law(
        plant,
        FlownLaw("scheduled", ScheduledPolicy(reference), np.zeros((1, 0)), np.zeros(0)),
        replace(scenario, reference=reference),
        envelope,
        progress=progress,
    )
