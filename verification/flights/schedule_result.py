"""A schedule of certified gains, and what it and a flight under it say."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controller.flight.flight_result import NonlinearFlight
from controller.policy.scheduled import DihedralChange, Schedule
from hfa_model.reporting.report import Block, Report, Reported
from hfa_model.reporting.text import Table, in_degrees
from hfa_model.support.errors import BadInputError
from hfa_model.vectors import LINEAR_STATES, UNITS
from trim.point.operating_point import OperatingPoint


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

    def block(self) -> Block:
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
        return Block((Table(header, rows), between))

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
