"""Loads and outputs, checked in steady flight and by derivatives of the motion."""

import numpy as np
import pytest
from random_points import equations, random_points, wind_of

import hfa_model
from hfa_model import STATES, Input, State


def outputs(aircraft, x, u, updraft=0.0):
    """Return the outputs at a state and an input, as numbers by name."""
    dynamics, p = hfa_model.variant_of(aircraft), hfa_model.parameters_of(aircraft)
    found = equations(State(*x), Input(*u), p, dynamics, wind_of(updraft=updraft))[1]
    return {name: float(value) for name, value in found.items()}


def center_height(dihedral, p):
    """Return the distance of the center panel below the center of mass, ft."""
    return p.panel_span / 3 * np.sin(dihedral)


def outer_height(dihedral, p):
    """Return the distance of an outer panel below the center of mass, ft."""
    return -p.panel_span / 6 * np.sin(dihedral)


def place_of_panel(x, height, side, p):
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


def velocity_of_panel(aircraft, x, u, height, side):
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


def later(aircraft, x, u, t):
    """Return the state t seconds later, computed by one step of the midpoint rule."""
    return x + t * aircraft.at(x + t / 2 * aircraft.at(x, u).f, u).f


@pytest.mark.parametrize(
    ("name", "height", "side"),
    [("load_factor_center", center_height, 0.0), ("load_factor_outer", outer_height, 1.0)],
)
def test_panel_load_factors_follow_the_moving_panels(aircraft, name, height, side):
    """The load factor of a panel is gravity minus acceleration, normal to the panel, divided by g. The
    acceleration is the difference of velocities of the panel 1e-5 s later and earlier.

    height: function that returns how far the panel is below the center of mass
    side: 0 for the center panel, 1 for the right outer one
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
