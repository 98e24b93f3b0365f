"""What a flight under a schedule says: the flight, and the schedule that flew it."""

from __future__ import annotations

from dataclasses import replace

from controller.flight.flight_report import flight_report, title
from controller.flight.simulate import NonlinearFlight
from controller.policy.scheduled import DihedralChange
from hfa_model.reporting.report import Block, Report
from hfa_model.reporting.text import Table, in_degrees
from verification.flights.scheduling import CertifiedSchedule


def schedule_report(result: NonlinearFlight, certified: CertifiedSchedule, change: DihedralChange, law: str) -> Report:
    """The report of the flight with that of the schedule, whose gains `law` has made."""
    flown = flight_report(result)
    words = f", to {in_degrees(change.end):g} deg over {change.duration:g} s, law {law}, scheduled"
    grid = {
        "law": law,
        "dihedrals": certified.schedule.dihedrals,
        "gains": certified.schedule.gains,
        "control_abscissae": [row.control_abscissa for row in certified.grid],
        "game_abscissae": [row.game_abscissa for row in certified.grid],
        "distances_from_exact": [row.distance for row in certified.grid],
        "largest_abscissa_between": certified.between,
    }
    return replace(
        flown,
        title=title(result, words),
        parts=(*flown.parts, grid_block(certified)),
        data={**flown.data, "schedule": grid},
    )


def grid_block(certified: CertifiedSchedule) -> Block:
    """One row a grid point, and what holds between them."""
    rows = [
        (
            f"{in_degrees(row.point.states.dihedral):g}",
            f"{row.control_abscissa:.4f}",
            f"{row.game_abscissa:.4f}",
            f"{row.distance:.1e}" if row.distance else "0",
            f"{row.certificates} hold",
        )
        for row in certified.grid
    ]
    header = ("dihedral deg", "abscissa A-BK 1/s", "abscissa A-SP 1/s", "K off the exact", "certificates")
    between = f"halfway between the points, interpolated gain: largest abscissa of A-BK {certified.between:.4f} 1/s"
    return Block((Table(header, rows), between))
