"""Designs for the tests of servos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from controller import load_design
from controller.design.design import Design

A_Z = "vertical_acceleration_short_period"


def measured_servo(**changed: object) -> Design:
    """The settings of `simvfa-1` from the three measurements of its servo."""
    settings: dict[str, object] = {
        "sensors": {"pitch_rate": 1e-4, "dihedral_integral": 1e-4, f"{A_Z}_integral": 1e-2},
    }
    return replace(load_design("simvfa-1"), **(settings | changed))  # type: ignore[arg-type]


def write_tuning(folder: Path, **changed: object) -> Path:
    """A small search on `own.toml`, the servo with sensors, beside it: tune.toml."""
    packaged = Path(__file__).parents[2] / "controller" / "designs" / "simvfa_1.toml"
    sensors = f"""
[sensors]
pitch_rate = 1e-4
dihedral_integral = 1e-4
{A_Z}_integral = 1e-2
"""
    (folder / "own.toml").write_text(packaged.read_text(encoding="utf-8") + sensors, encoding="utf-8")
    settings = {"design": str(folder / "own.toml"), "evaluations": 12, "seed": 1, "angles": [11], "rate": 1.0}
    lines = [f"{key} = {value!r}" for key, value in (settings | changed).items()]
    tables = f"""
[variables.effort]
entries = ["weights.inputs.aileron_outer", "weights.inputs.elevator_center"]
low = 5.0
high = 500.0

[objective]
dihedral = 100.0

[[cases]]
dihedral = 11
effectiveness = 0.7
each = 20
[cases.ends]
dihedral = [1.0, -0.5]
{A_Z} = [-1.0, 0.5]
"""
    (folder / "tune.toml").write_text("\n".join(lines) + "\n" + tables, encoding="utf-8")
    return folder / "tune.toml"
