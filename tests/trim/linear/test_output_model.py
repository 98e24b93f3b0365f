"""What a linear model watches and is blown by: names, winds by panel, and against the released simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from known_models import released_simulation

from controller.flight.closed_loop import LinearPlant
from hfa_model import LINEAR_STATES, STATES, Aircraft, Parameters
from hfa_model.kinematics import DISTURBANCES
from hfa_support import BadInputError
from hfa_support.model import Model
from trim import LinearModel, OperatingPoint, find_operating_point, level_flight, linearize

NAMES = tuple(DISTURBANCES)
#: Entries of the wind columns of SimVFA (B. Thomsen, 2018, data/VFA_trimData.mat) at 68 ft/s and 11 deg.
PEER: dict[str, dict[str, float]] = {
    "headwind_center": {"speed": 0.0, "alpha": -4.25540178e-03, "pitch_rate": -3.53879464e-03},
    "updraft_center": {"speed": 2.11937536e-02, "alpha": -4.49771578e-02, "pitch_rate": -3.63933427e-01},
    "headwind_outer": {"speed": 0.0, "alpha": -9.64155891e-03, "dihedral_rate": 5.30927866e-03},
    "updraft_outer": {"speed": 4.01027033e-02, "pitch_rate": -1.55866503, "dihedral_rate": 4.77260822e-02},
}


def point_of(aircraft: Aircraft, degrees: float = 11.0, **given: float) -> OperatingPoint:
    return find_operating_point(aircraft, level_flight(math.radians(degrees), **given))


@pytest.fixture(scope="module")
def model(published_aircraft: Aircraft) -> LinearModel:
    return linearize(published_aircraft, point_of(published_aircraft, 15.0), full=True)


def test_select_takes_rows_and_columns_by_name(model: LinearModel) -> None:
    part = model.select(("pitch_rate", "speed"))
    q, speed = STATES.index("pitch_rate"), STATES.index("speed")
    expected = np.array([[model.A[q, q], model.A[q, speed]], [model.A[speed, q], model.A[speed, speed]]])
    np.testing.assert_array_equal(part.A, expected)
    np.testing.assert_array_equal(part.B, model.B[[q, speed]])
    assert part.states == ("pitch_rate", "speed")
    assert part.state_units == ("rad/s", "ft/s")
    np.testing.assert_array_equal(part.state_offsets, [0.0, 68.0])
    with pytest.raises(BadInputError, match="unknown state 'yaw'"):
        model.select(("speed", "yaw"))


def test_a_point_of_other_dynamics_is_refused(model: LinearModel, parameters: Parameters) -> None:
    with pytest.raises(BadInputError, match="trimmed with 'published' dynamics, the aircraft has 'newton'"):
        linearize(Aircraft(parameters, "newton"), model.point)


def over_ground(aircraft: Aircraft) -> Model:
    """Its drag takes the speed over ground, not that through the air."""
    model = aircraft.model
    return replace(model, equations=replace(model.equations, ground_drag=True))  # type: ignore[type-var]


def test_panels_add_up_to_the_uniform_wind(aircraft: Aircraft) -> None:
    point = point_of(aircraft)
    model = linearize(aircraft, point, full=True, disturbances=NAMES)
    column = dict(zip(model.disturbances, model.E.T, strict=True))
    for kind in ("updraft", "headwind"):
        both = column[f"{kind}_center"] + column[f"{kind}_outer"]
        np.testing.assert_allclose(both, column[kind], rtol=1e-12, atol=1e-15)
    assert model.disturbances == NAMES
    otherwise = linearize(over_ground(aircraft), point, full=True, disturbances=NAMES)
    assert np.abs(otherwise.E - model.E).max() > 1e-2  # a drag of the wrong speed would show
    gust = LinearPlant.at(aircraft, point, ("updraft",)).E["updraft"]
    np.testing.assert_allclose(column["updraft"], gust, rtol=1e-12, atol=1e-15)
    # In level trim all forces balance, so that a wind from ahead does what more speed over ground does.
    np.testing.assert_allclose(column["headwind"], model.A[:, STATES.index("speed")], rtol=1e-9, atol=1e-12)
    assert np.array_equal(linearize(aircraft, point, full=True, outputs=("alpha",)).E[:, 0], column["updraft"])
    assert np.abs(column["outward_outer"]).max() > 0.1  # raised panels meet it
    flat = linearize(aircraft, point_of(aircraft, 0.0), disturbances=("outward_outer",))
    assert np.abs(flat.E).max() <= 1e-15  # level ones do not


def peer_errors(*, ground_drag: bool) -> dict[str, float]:
    """Column -> its largest relative error, with the parameters and the density of the released simulation."""
    aircraft, altitude = released_simulation()
    point = point_of(aircraft, altitude=altitude)
    model = linearize(over_ground(aircraft) if ground_drag else aircraft, point, disturbances=tuple(PEER))
    found = {}
    for name, column in zip(model.disturbances, model.E.T, strict=True):
        errors = [abs(column[LINEAR_STATES.index(row)] - value) for row, value in PEER[name].items()]
        found[name] = max(errors) / max(map(abs, PEER[name].values()))
    return found


def test_four_columns_of_the_released_simulation_come_out_with_drag_over_ground() -> None:
    same, through_the_air = peer_errors(ground_drag=True), peer_errors(ground_drag=False)
    assert max(same.values()) <= 2e-8
    assert same["updraft_outer"] <= 4e-9  # half a unit of the last digit here
    assert through_the_air["headwind_center"] > 1.0
    assert through_the_air["headwind_outer"] > 1.0
    assert through_the_air["updraft_outer"] <= 4e-9  # to first order a wind from below changes no speed in level flight
