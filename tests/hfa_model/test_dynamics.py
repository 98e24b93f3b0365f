"""The aircraft in steady flight and near it: loads that balance, controls of the right sign, sizes."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import model_at

from hfa_model import Aircraft
from hfa_support import BadInputError
from trim import find_operating_point, level_flight, linearize

DEGREES_15 = float(np.radians(15.0))


@pytest.mark.parametrize("degrees", [0.0, 5.0, 15.0, 20.0])
def test_loads_at_trim_are_those_of_steady_flight(aircraft: Aircraft, degrees: float) -> None:
    """L + T sin α = W, D = T cos α, M = 0, H = k η, all from `loads` alone; lift and drag are positive."""
    point = model_at(degrees, aircraft.variant.name).point
    loads, p = aircraft.loads(np.array(point.states), np.array(point.inputs)), aircraft.parameters
    weight = 3 * p.panel_mass * p.gravity
    assert min(loads.lift, loads.drag, loads.center.lift, loads.outer.lift, loads.center.drag, loads.outer.drag) > 0
    assert loads.lift + loads.thrust * np.sin(point.states.alpha) == pytest.approx(weight, rel=1e-12)
    assert loads.thrust * np.cos(point.states.alpha) == pytest.approx(loads.drag, rel=1e-12)
    assert loads.pitching_moment == pytest.approx(0.0, abs=1e-9 * weight * p.boom_length)
    # Level and steady: nothing else acts on the hinge.
    assert loads.hinge_moment == pytest.approx(p.hinge_stiffness * point.states.dihedral, abs=1e-6)


def test_controls_act_in_the_right_direction(aircraft: Aircraft) -> None:
    """More thrust speeds up; trailing edge down on the tail pitches down, on the outer wings raises the tips."""
    model = linearize(aircraft, find_operating_point(aircraft, level_flight(DEGREES_15)), full=True)
    effect = {(s, u): model.B[i, j] for i, s in enumerate(model.states) for j, u in enumerate(model.inputs)}
    assert effect["speed", "throttle"] > 0
    assert effect["pitch_rate", "elevator_center"] < 0
    assert effect["pitch_rate", "elevator_outer"] < 0
    assert effect["dihedral_rate", "aileron_outer"] > 0
    assert effect["alpha", "aileron_center"] < 0


def test_sizes_below_zero_and_masked_states_are_refused(aircraft: Aircraft) -> None:
    for name in ("panel_mass", "panel_span", "chord"):
        with pytest.raises(BadInputError, match=f"parameter {name} is -1; it must be positive"):
            Aircraft(aircraft.parameters._replace(**{name: -1.0}))
    state = np.ma.masked_array(np.ones(7), mask=[True] + [False] * 6)
    with pytest.raises(BadInputError, match="state has masked entries"):
        aircraft.rates(state, np.zeros(5))
