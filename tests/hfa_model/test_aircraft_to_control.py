"""The aircraft as python-control's `NonlinearIOSystem`: its own trim, linearization and simulation agree with ours."""

from __future__ import annotations

import control
import numpy as np
import pytest
from known_models import model_at

from hfa_model import INPUTS, STATES, Aircraft
from trim import OperatingPoint, linearize

#: What python-control solves for, and the equations that it balances.
HELD = [INPUTS.index("aileron_center")]
BALANCED = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]


@pytest.fixture(scope="module")
def trimmed(aircraft: Aircraft) -> OperatingPoint:
    return model_at(10.0, aircraft.variant.name).point


def test_its_operating_point_is_ours(aircraft: Aircraft, trimmed: OperatingPoint) -> None:
    found = control.find_operating_point(
        aircraft.to_control(),
        np.array(trimmed.states),
        [40.0, 0.0, 0.0, 0.0, 0.0],
        np.array(trimmed.states),
        output_indices=list(range(7)),
        input_indices=HELD,
        deriv_indices=BALANCED,
        root_kwargs={"tol": 1e-14},
    )
    np.testing.assert_allclose(found.inputs, np.array(trimmed.inputs), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(found.states, np.array(trimmed.states), rtol=1e-12, atol=1e-14)


def test_its_linearization_is_ours(aircraft: Aircraft, trimmed: OperatingPoint) -> None:
    model = linearize(aircraft, trimmed, full=True)
    found = control.linearize(aircraft.to_control(), trimmed.to_control(), copy_names=True)
    assert found.state_labels == list(STATES)
    assert found.input_labels == list(INPUTS)
    # It takes differences of 1e-6.
    for theirs, ours in ((found.A, model.A), (found.B, model.B)):
        assert np.linalg.norm(theirs - ours) < 1e-5 * np.linalg.norm(ours)


def test_a_parameter_is_changed_by_name(aircraft: Aircraft, trimmed: OperatingPoint) -> None:
    heavier = Aircraft(aircraft.parameters._replace(panel_mass=10.0), aircraft.variant)
    x, u = np.array(trimmed.states), np.array(trimmed.inputs)
    theirs = aircraft.to_control().dynamics(0.0, x, u, params={"panel_mass": 10.0})
    np.testing.assert_array_equal(theirs, heavier.rates(x, u))
    assert not np.array_equal(theirs, aircraft.rates(x, u))
