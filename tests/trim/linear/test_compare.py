"""`hfa linearize` shows the print beside the model at the printed flight conditions, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hfa_model.aircraft import Aircraft
from hfa_model.published import published_models
from trim.linear.compare import printed_at
from trim.point.condition import level_flight
from trim.point.operating_point import OperatingPoint
from trim.point.solve import find_operating_point


@pytest.mark.parametrize("degrees", [model.dihedral_deg for model in published_models()])
def test_at_a_printed_angle_it_is_that_print(aircraft: Aircraft, degrees: float) -> None:
    printed = printed_at(find_operating_point(aircraft, level_flight(float(np.radians(degrees)))))
    assert printed is not None
    assert printed.dihedral_deg == degrees


@pytest.fixture(scope="module")
def at_15(published_aircraft: Aircraft) -> OperatingPoint:
    return find_operating_point(published_aircraft, level_flight(float(np.radians(15.0))))


@pytest.mark.parametrize("name", ["speed", "alpha", "altitude", "pitch", "pitch_rate", "dihedral", "dihedral_rate"])
def test_one_state_aside_there_is_no_print(at_15: OperatingPoint, name: str) -> None:
    """Each state but the rest as printed; a rounding error still counts as printed."""
    value = getattr(at_15.states, name)
    assert printed_at(replace(at_15, states=at_15.states._replace(**{name: value + 1e-4 * (1 + abs(value))}))) is None
    assert printed_at(replace(at_15, states=at_15.states._replace(**{name: value * (1 + 1e-14)}))) is not None


def test_a_center_aileron_aside_there_is_no_print(at_15: OperatingPoint) -> None:
    assert printed_at(replace(at_15, inputs=at_15.inputs._replace(aileron_center=0.01))) is None
