"""Trade-off in the choice of the servo's gain on the vertical acceleration A_z.

The gain affects tracking with a fault, the largest gusts and the margins.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

import hfa
import hfa_model
from hfa.extend import Report
from hfa.paper import level_model
from hfa_aircraft.model import Model
from hfa_design import design_controller, load_design
from hfa_design.servo_loops import check_margins
from hfa_support.reporting.text import Table
from studies.servo.comparison import CASES, TRIM_DEG, fly_case
from studies.servo.flights import ASKED, REAL, gust_held
from studies.servo.simvfa import REGULATED

#: Factors on the gain of A_z; duration of the commands, s, which is the first three steps; largest
#: gust that is tested, ft/s.
FACTORS = (0.25, 0.5, 1.0, 1.5, 2.0)
SECONDS = 211.0
LARGEST = 60.0


def front(aircraft: Model) -> Report:
    """Return a report of tracking errors, largest updrafts and margins for several gains on A_z.

    The dihedral angle is 11 deg. The tracking errors are simulated with the actuators and the fault
    of `order-1-fault`, and the updrafts with first-order actuators of 2 rad/s. The margins are the
    smallest of all inputs and sensors, with actuators of order 1 and 2 at 2 and 10 rad/s.
    """
    design = load_design("servo", hfa.aircraft()).of(aircraft)
    model = level_model(aircraft, math.radians(TRIM_DEG))
    assert design.shaping is not None  # of the servo design
    points: list[dict[str, Any]] = []
    for factor in FACTORS:
        weight = design.shaping.outputs[REGULATED[1]]
        outputs = {
            **design.shaping.outputs,
            REGULATED[1]: weight._replace(gain=factor * weight.gain),
        }
        own = replace(design, name=f"{factor:g}", shaping=design.shaping._replace(outputs=outputs))
        made = design_controller(aircraft, own, np.array(design.shaping.breakpoints))
        single = check_margins(aircraft, made, np.radians([TRIM_DEG]), (2.0, 10.0)).single
        (flight,) = fly_case(
            aircraft, CASES["order-1-fault"], {own.name: made}, SECONDS, only=[own.name]
        )
        gusts = {
            f"{length:g}": gust_held(aircraft, model, made, REAL[0], length, LARGEST)
            for length in sorted(ASKED)
        }
        point = {
            "factor": factor,
            "acceleration": flight.tracked[1].rms,
            "dihedral": flight.tracked[0].rms,
        }
        margin = {
            "gain": min(each.gain for each in single),
            "phase": min(each.phase for each in single),
        }
        points.append(point | margin | {"updrafts": gusts})
    rows = [
        (
            f"{each['factor']:g}",
            f"{each['acceleration']:.3f}",
            f"{math.degrees(each['dihedral']):.3f}",
            *(f"{each['updrafts'][f'{length:g}']:.0f}" for length in sorted(ASKED)),
            f"{each['gain']:.1f}",
            f"{each['phase']:.0f}",
        )
        for each in points
    ]
    lengths = tuple(f"{length:g} ft" for length in sorted(ASKED))
    header = ("factor", "A_z ft/s^2", "dihedral deg", *lengths, "gain dB", "phase deg")
    title = f"Gain of A_z against updrafts, {hfa_model.variant_of(aircraft).name} dynamics"
    return Report(title, (Table(header, rows),), data={"points": points})
