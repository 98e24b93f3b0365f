"""Uniform wind: Galilean invariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_points import random_points, rates, wind_of

from hfa_model import Input, Parameters, State


def state_over_ground(x: State, updraft: float, headwind: float) -> State:
    """Return the state over ground of an aircraft in wind.

    x: state relative to the air
    updraft, headwind: uniform wind, ft/s
    """
    gamma = x.pitch - x.alpha
    north = x.speed * np.cos(gamma) - headwind
    up = x.speed * np.sin(gamma) + updraft
    return x._replace(
        speed=float(np.hypot(north, up)), alpha=x.pitch - float(np.arctan2(up, north))
    )


def inertial(x: State, rate: State) -> np.ndarray:
    """Return the accelerations north, up, in pitch and in dihedral, (4,).

    These accelerations are equal for all observers in uniform motion.
    """
    gamma = x.pitch - x.alpha
    gamma_rate = rate.pitch - rate.alpha
    along = np.array([np.cos(gamma), np.sin(gamma)])
    across = np.array([-np.sin(gamma), np.cos(gamma)])
    return np.array(
        [*(rate.speed * along + x.speed * gamma_rate * across), rate.pitch_rate, rate.dihedral_rate]
    )


def galilean_error(parameters: Parameters, dynamics: str, wind: Any) -> np.ndarray:
    """Return the largest difference of the accelerations between uniform steady wind and still air,
    (4,).

    100 random states and inputs are compared.
    """
    worst = np.zeros(4)
    for state, control in zip(*random_points(100, seed=5), strict=True):
        x = State(*state.tolist())
        u = Input(*control.tolist())
        moving = state_over_ground(x, wind.updraft, wind.headwind)
        still = inertial(x, rates(x, u, parameters, dynamics))
        error = np.abs(inertial(moving, rates(moving, u, parameters, dynamics, wind)) - still)
        worst = np.maximum(worst, error)
    return worst


@pytest.mark.parametrize(("updraft", "headwind"), [(15.0, 0.0), (0.0, -15.0), (-9.0, 12.0)])
def test_steady_wind_changes_published_and_not_newton(
    parameters: Parameters, updraft: float, headwind: float
) -> None:
    """Uniform steady wind changes only the hinge acceleration of "published", and nothing of
    "newton".
    """
    wind = wind_of(updraft=updraft, headwind=headwind)
    newton, published = (galilean_error(parameters, name, wind) for name in ("newton", "published"))
    assert newton.max() <= 1e-9
    assert published[:3].max() <= 1e-9  # V over ground occurs only in the equation of the hinge
    assert published[3] > 1e-2
