"""What a controller says of itself: the numbers of its `about`, and which angle has the smallest margin."""

from __future__ import annotations

import math
from typing import Any

from controllers import small_controller

from hfa_model import Aircraft
from hfa_support.reporting.text import Table


def row(degrees: float, disk: float, ok: bool) -> dict[str, Any]:
    margin = {"disk": disk, "gain": 2.0, "phase": 33.0}
    return {
        "dihedral": math.radians(degrees),
        "delta_min": 7.25,
        "abscissa": -0.125,
        "margin_at_inputs": margin,
        "margin_at_sensors": margin | {"disk": 1.0 - disk},
        "checks": [{"ok": True}, {"ok": ok}],
    }


def test_it_names_the_smallest_margins_and_what_it_is_told(published_aircraft: Aircraft) -> None:
    about = {"delta": 200.0, "angles": [row(5, 0.3, True), row(10, 0.2, False), row(20, 0.4, True)]}
    report = small_controller(published_aircraft, about=about).report()
    assert report.title == "Controller small: output feedback, 1 states, 3 angles from 5 to 20 deg, published dynamics"
    first, table, smallest = report.parts
    assert first == (
        "delta 200; measured: pitch_rate, dihedral; moved: aileron_outer; told: dihedral_command,"
        " dihedral_command_rate; of a command filter of 0.5 rad/s, damping 2"
    )
    assert isinstance(table, Table)
    assert [tuple(each)[:-1] for each in table.rows][1] == ("10", "7.25", "-0.1250", "0.2000", "0.8000")
    assert [str(each[-1]) for each in table.rows] == ["PASS", "FAIL", "PASS"]
    assert smallest == (
        "smallest disk margin at inputs: 0.2000 at 10 deg, gain 2, phase 33 deg\n"
        "smallest disk margin at sensors: 0.6000 at 20 deg, gain 2, phase 33 deg"
    )
    assert (report.data["delta"], report.data["angles"]) == (200.0, about["angles"])
