"""Designs that several tests of this extension use."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from hfa_design import Design
from studies.servo import simvfa
from studies.servo.simvfa import simvfa_design

#: Files of SimVFA's designs.
SIMVFA = {
    name: str(Path(simvfa.__file__).parent / "designs" / f"{name}.toml")
    for name in ("simvfa-1", "simvfa-2")
}
A_Z = "vertical_acceleration_short_period"


def measured_servo(**changed: object) -> Design:
    """Return the design `simvfa-1` with three sensors, and with changed fields."""
    settings: dict[str, object] = {
        "sensors": {"pitch_rate": 1e-4, "dihedral_integral": 1e-4, f"{A_Z}_integral": 1e-2}
    }
    return replace(simvfa_design("simvfa-1"), **(settings | changed))  # type: ignore[arg-type]
