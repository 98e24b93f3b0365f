"""What `hfa servo` says: one table a case."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from controller.design.design import signal_unit
from hfa_model.reporting.report import Block, Report
from hfa_model.reporting.text import Table, shown_unit
from hfa_model.reporting.unit_system import in_force
from verification.servo.reference_model import REGULATED

SCHEMA = "hfa.servo-table/1"
_ACCELERATION = signal_unit(REGULATED[1])


def servo_report(results: Sequence[Mapping[str, Any]]) -> Report:
    """Root mean square errors, surface rates, and what was lost, law by law."""
    blocks = [Block((_title(result), _table(result))) for result in results]
    title = "Servos through the commands and the actuator faults of SimVFA"
    return Report(title, tuple(blocks), data={"schema": SCHEMA, "cases": list(results)})


def _title(result: Mapping[str, Any]) -> str:
    return f"case {result['case']}, {result['dynamics']} dynamics, {result['duration']:g} s"


def _table(result: Mapping[str, Any]) -> Table:
    header = ("law", "rms dihedral deg", f"rms A_z {shown_unit(_ACCELERATION)}", "fastest surface deg/s", "outcome")
    return Table(header, rows_of(result))


def rows_of(result: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """Law, both rms errors, surface rate and outcome, a row a law."""
    angle, acceleration = REGULATED
    rows: list[tuple[str, ...]] = []
    for flight in result["flights"]:
        rms, lost = flight["rms_error"], flight["lost_at"]
        rows.append(
            (
                flight["law"],
                f"{math.degrees(rms[angle]):.3f}",
                f"{in_force(rms[acceleration], _ACCELERATION):.3f}",
                f"{math.degrees(flight['fastest_surface']):.3g}",
                "held" if lost is None else f"{flight['left']} left at {lost:.4g} s",
            )
        )
    return rows
