"""A schedule of certified gains over the dihedral, the flight through a slow change of dihedral, and what both say."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from controller.flight.envelope import Envelope
from controller.flight.flight_result import NonlinearFlight
from controller.flight.plants import NonlinearPlant
from controller.flight.scenario import Scenario, with_errors
from controller.flight.simulate import fly_law
from controller.game.zero_sum import published_game
from controller.policy.flown_law import FlownLaw
from controller.policy.gain_table import GainTable
from controller.policy.learned_gain import learned_value
from controller.policy.scheduled import DihedralChange, Schedule, ScheduledPolicy, ScheduledReference
from controller.riccati.balancing import spectrum
from controller.riccati.gare import solve_game
from hfa_model.aircraft import Aircraft
from hfa_model.vectors import LINEAR_STATES, UNITS
from hfa_support.errors import BadInputError
from hfa_support.progress import Progress, told
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, in_degrees
from trim.linear.linear_model import LinearModel, linearize
from trim.point.condition import TrimCondition, level_flight
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point

#: Flight before and after a change of dihedral, s.
LEAD, REST = 5.0, 15.0


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
        gain = np.array(schedule.gain_at(dihedral))
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
