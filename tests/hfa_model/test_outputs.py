"""Loads and outputs, checked in steady flight and by derivatives of the motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from known_models import model_at
from random_points import equations, random_points, wind_of

import hfa
import hfa_model
from hfa import BadInputError, Model, trim
from hfa.paper import level_flight
from hfa_model import STATES, Input, Parameters, State


def outputs(
    aircraft: Model, x: np.ndarray, u: np.ndarray, updraft: float = 0.0
) -> dict[str, float]:
    dynamics, p = hfa_model.variant_of(aircraft), hfa_model.parameters_of(aircraft)
    found = equations(State(*x), Input(*u), p, dynamics, wind_of(updraft=updraft))[1]
    return {name: float(value) for name, value in found.items()}


def center_height(dihedral: float, p: Parameters) -> float:
    """Return the distance of the center panel below the center of mass, ft."""
    return p.panel_span / 3 * np.sin(dihedral)


def outer_height(dihedral: float, p: Parameters) -> float:
    """Return the distance of an outer panel below the center of mass, ft."""
    return -p.panel_span / 6 * np.sin(dihedral)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 15.0, 20.0])
def test_steady_level_flight_balances_the_loads(aircraft: Model, degrees: float) -> None:
    """In steady level flight the loads satisfy L + T sin α = W, T cos α = D, M = 0 and H = k η.

    Lift and drag are positive, and the outputs agree with the loads.
    """
    point = model_at(degrees, hfa_model.variant_of(aircraft).name).point
    p = hfa_model.parameters_of(aircraft)
    loads = hfa_model.loads(aircraft, point.states, point.inputs)
    weight = 3 * p.panel_mass * p.gravity
    assert (
        min(
            loads.lift,
            loads.drag,
            loads.center.lift,
            loads.outer.lift,
            loads.center.drag,
            loads.outer.drag,
        )
        > 0
    )
    assert loads.lift + loads.thrust * np.sin(point.states.alpha) == pytest.approx(
        weight, rel=1e-12
    )
    assert loads.thrust * np.cos(point.states.alpha) == pytest.approx(loads.drag, rel=1e-12)
    assert loads.pitching_moment == pytest.approx(0.0, abs=1e-9 * weight * p.boom_length)
    assert loads.hinge_moment == pytest.approx(p.hinge_stiffness * point.states.dihedral, abs=1e-6)
    computed = outputs(aircraft, np.array(point.states), np.array(point.inputs))
    assert computed["load_factor"] == pytest.approx(1.0, abs=1e-9)
    assert computed["vertical_acceleration"] == pytest.approx(0.0, abs=1e-9)
    assert computed["load_factor_center"] == pytest.approx(np.cos(point.states.pitch), abs=1e-9)
    assert computed["load_factor_outer"] == pytest.approx(
        np.cos(point.states.pitch) * np.cos(point.states.dihedral), abs=1e-9
    )
    assert computed["climb_rate"] == pytest.approx(0.0, abs=1e-9)
    assert computed["gamma"] == pytest.approx(0.0, abs=1e-12)
    assert computed["alpha_air_center"] == pytest.approx(point.states.alpha, abs=1e-12)
    assert computed["hinge_moment_total"] == pytest.approx(0.0, abs=1e-6)
    assert computed["lift_center"] + 2 * computed["lift_outer"] * np.cos(
        point.states.dihedral
    ) == pytest.approx(loads.lift, rel=0.05)


def place_of_panel(x: np.ndarray, height: Callable, side: float, p: Parameters) -> np.ndarray:
    """Return the position of a panel relative to the center of mass, (north, east, down), ft.

    height: function (dihedral, p) -> distance of the panel below the center of mass, ft
    side: 1 for the right panel, -1 for the left panel, 0 for the center panel
    """
    eta = x[STATES.index("dihedral")]
    theta = x[STATES.index("pitch")]
    down = float(height(eta, p))
    return np.array(
        [down * np.sin(theta), side * p.panel_span / 2 * (1 + np.cos(eta)), down * np.cos(theta)]
    )


def velocity_of_panel(
    aircraft: Model, x: np.ndarray, u: np.ndarray, height: Callable, side: float
) -> np.ndarray:
    """Return the velocity of a panel, (north, east, down), ft/s.

    The result is the velocity of the center of mass plus the rate of the panel's relative position.

    height, side: as for `place_of_panel`
    """
    state = State(*x)
    ahead = 1e-6 * aircraft.at(x, u).f
    places = [
        place_of_panel(x + sign * ahead, height, side, hfa_model.parameters_of(aircraft))
        for sign in (1, -1)
    ]
    gamma = state.pitch - state.alpha
    path = np.array([state.speed * np.cos(gamma), 0.0, -state.speed * np.sin(gamma)])
    return path + (places[0] - places[1]) / 2e-6


def later(aircraft: Model, x: np.ndarray, u: np.ndarray, t: float) -> np.ndarray:
    """Return the state t seconds later, computed by one step of the midpoint rule."""
    return np.asarray(x + t * aircraft.at(x + t / 2 * aircraft.at(x, u).f, u).f)


@pytest.mark.parametrize(
    ("name", "height", "side"),
    [("load_factor_center", center_height, 0.0), ("load_factor_outer", outer_height, 1.0)],
)
def test_panel_load_factors_follow_the_moving_panels(
    aircraft: Model, name: str, height: Callable, side: float
) -> None:
    """The load factor of a panel is gravity minus acceleration, normal to the panel, divided by g.

    The acceleration is computed by differences along the motion.
    """
    gravity = np.array([0.0, 0.0, hfa_model.parameters_of(aircraft).gravity])
    for x, u in zip(*random_points(20, seed=11), strict=True):
        velocities = [
            velocity_of_panel(aircraft, later(aircraft, x, u, t), u, height, side)
            for t in (1e-5, -1e-5)
        ]
        acceleration = (velocities[0] - velocities[1]) / 2e-5
        theta = x[STATES.index("pitch")]
        eta = side * x[STATES.index("dihedral")]
        across = np.array([np.sin(theta) * np.cos(eta), np.sin(eta), np.cos(theta) * np.cos(eta)])
        felt = (gravity - acceleration) @ across / gravity[2]
        assert outputs(aircraft, x, u)[name] == pytest.approx(felt, rel=2e-5, abs=2e-5)


def test_an_updraft_increases_only_the_air_angle(published_aircraft: Model) -> None:
    """An updraft increases the angle of attack by w/V and the load factor, but not gamma."""
    point = trim(published_aircraft, level_flight(0.2))
    x = np.array(point.states)
    u = np.array(point.inputs)
    still = outputs(published_aircraft, x, u)
    rising = outputs(published_aircraft, x, u, 5.0)
    assert rising["alpha_air_center"] - still["alpha_air_center"] == pytest.approx(
        5.0 / 68.0, rel=0.01
    )
    assert rising["angle_of_attack"] == pytest.approx(
        rising["alpha_air_center"], abs=1e-12
    )  # all rates are 0 here
    assert still["angle_of_attack"] == point.states.alpha
    assert rising["load_factor"] > still["load_factor"]
    assert rising["gamma"] == still["gamma"]


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("speed", 0.0, "speed is 0 ft/s; give a positive speed"),
        ("altitude", 1e6, "give an altitude from 0 to 65000 ft"),
        ("dihedral", np.pi / 2, "dihedral is 90 deg; give an angle above -90 and below 90 deg"),
    ],
)
def test_loads_out_of_range_are_refused(name: str, value: float, message: str) -> None:
    """Loads at a state out of range are refused, and the message names the state."""
    model = hfa.aircraft()
    point = trim(model, level_flight(0.1))
    state = State(*point.states)._replace(**{name: value})
    with pytest.raises(BadInputError, match=message):
        hfa_model.loads(model, state, point.inputs)
