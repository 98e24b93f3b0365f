"""Designs and linear models for the tests of servos."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

from controller import Design, load_design
from controller.design.design import Feedforward
from hfa_model import Aircraft
from trim import LinearModel, find_operating_point, level_flight, linearize

A_Z = "vertical_acceleration_short_period"


def measured_servo(**changed: object) -> Design:
    """The settings of `simvfa-1` from the three measurements of its servo, with a feedforward."""
    settings: dict[str, object] = {
        "sensors": {"pitch_rate": 1e-4, "dihedral_integral": 1e-4, f"{A_Z}_integral": 1e-2},
        "feedforward": Feedforward(),
    }
    return replace(load_design("simvfa-1"), **(settings | changed))  # type: ignore[arg-type]


@cache
def model_at(degrees: float, dynamics: str = "published") -> LinearModel:
    aircraft = Aircraft(dynamics=dynamics)
    return linearize(aircraft, find_operating_point(aircraft, level_flight(math.radians(degrees))))
