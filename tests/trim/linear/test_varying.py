"""Interpolated models against exact ones, and linear models along a flight against the difference
of two flights."""

from __future__ import annotations

import subprocess
from itertools import pairwise
from pathlib import Path

import casadi as ca
import control
import numpy as np
import pytest
from c_files import COMPILER, needs_gcc
from own_models import F16, NAVION, trimmed
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import hfa_model
from hfa_support import BadInputError
from trim import InterpolatedModel, level_model, models_along, sweep

GRID = {"dihedral": np.radians([0.0, 5.0, 10.0, 15.0]), "speed": np.array([60.0, 68.0, 76.0])}


@pytest.fixture(scope="module")
def model() -> InterpolatedModel:
    return InterpolatedModel(sweep(hfa_model.aircraft(), GRID))


def test_it_is_exact_at_the_points_and_bilinear_between(model: InterpolatedModel) -> None:
    exact = level_model(hfa_model.aircraft(), float(GRID["dihedral"][2]))
    here = model.at(dihedral=GRID["dihedral"][2], speed=68.0)
    np.testing.assert_allclose(here.A, exact.A, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(here.inputs, exact.input_offsets, rtol=1e-9, atol=1e-12)
    ends = [
        model.at(dihedral=eta, speed=speed).B
        for eta in GRID["dihedral"][:2]
        for speed in (60.0, 68.0)
    ]
    between = model.at(dihedral=np.radians(1.25), speed=66.0).B
    weights = np.outer([0.75, 0.25], [0.25, 0.75]).ravel()
    np.testing.assert_allclose(
        between, sum(w * B for w, B in zip(weights, ends, strict=True)), rtol=1e-12
    )


@needs_gcc
def test_the_same_in_c(model: InterpolatedModel, folder: Path) -> None:
    """At random places, at the points, and beyond an end, where the last value holds."""
    model.to_casadi().generate("models.c")
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-o", "models.so", "models.c", "-lm"], check=True
    )
    function = ca.external("models", "./models.so")
    rng, eta = np.random.default_rng(4), GRID["dihedral"]
    places = [
        *zip(rng.uniform(0, eta[-1], 20), rng.uniform(60, 76, 20), strict=True),
        (eta[1], 68.0),
        (eta[-1], 76.0),
    ]
    for place in places:
        for one, other in zip(
            function(list(place)), model.at(dihedral=place[0], speed=place[1]), strict=True
        ):
            np.testing.assert_allclose(
                np.array(one).reshape(other.shape), other, rtol=1e-12, atol=1e-12
            )
    np.testing.assert_array_equal(function([0.5, 80.0])[2], function([eta[-1], 76.0])[2])


def test_the_error_falls_with_the_square_of_the_step(model: InterpolatedModel) -> None:
    """At the middles of the cells, where exact models are made anew."""
    finer = {name: np.linspace(axis[0], axis[-1], 2 * len(axis) - 1) for name, axis in GRID.items()}
    errors = []
    for each in (model, InterpolatedModel(sweep(hfa_model.aircraft(), finer))):
        middles = {
            name: (axis[1:] + axis[:-1]) / 2 for name, axis in zip(GRID, each.axes, strict=True)
        }
        exact = sweep(hfa_model.aircraft(), middles)
        near = each.at(**dict(zip(GRID, exact.values.T, strict=True)))
        pairs = (near.A, exact.A), (near.B, exact.B)
        errors.append(
            [(np.abs(a - b).max(axis=(1, 2)) / np.abs(b).max(axis=(1, 2))).max() for a, b in pairs]
        )
    ratios = np.divide(*errors)
    assert ((ratios > 3.0) & (ratios < 5.0)).all(), ratios


def test_what_cannot_be_interpolated_is_named(model: InterpolatedModel) -> None:
    with pytest.raises(
        BadInputError, match="speed lies outside of the sweep, which goes from 60 ft/s to 76 ft/s"
    ):
        model.at(dihedral=0.1, speed=50.0)
    with pytest.raises(BadInputError, match="give dihedral, speed, by name"):
        model.at(speed=68.0)
    with pytest.raises(BadInputError, match="no trim at dihedral 0 deg, speed 5 ft/s"):
        InterpolatedModel(
            sweep(hfa_model.aircraft(), {"dihedral": [0.0, 0.1], "speed": [5.0, 68.0]})
        )


def test_along_a_flight_small_deviations_follow_the_linear_model() -> None:
    """The Navion after a step of elevator and rudder: two flights differ by δx of δx' = A(t) δx, to
    second order."""
    point = trimmed(NAVION)
    u = np.array(point.inputs) + np.array([0.0, -0.05, 0.0, 0.05])
    function = NAVION.functions(())

    def rates(_: float, x: np.ndarray) -> np.ndarray:
        return np.array(function(x, u, [])[0]).ravel()

    def flown(x: np.ndarray) -> np.ndarray:
        times = np.linspace(0.0, 3.0, 121)
        return solve_ivp(rates, (0.0, 3.0), x, t_eval=times, rtol=1e-10, atol=1e-12).y.T

    states, start = (
        flown(np.array(point.states)),
        np.array([1.0, 0.01, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0]),
    )
    along = models_along(NAVION, states, np.tile(u, (len(states), 1)))
    np.testing.assert_allclose(along.rates, [rates(0.0, x) for x in states], rtol=1e-12, atol=1e-12)

    def predicted(A: np.ndarray) -> np.ndarray:
        """δx(3 s) by steps of the matrix exponential at the middle of each."""
        found = start
        for one, other in pairwise(A):
            found = expm((one + other) / 2 * 3.0 / (len(A) - 1)) @ found
        return found

    sizes = np.array([each.nominal for each in NAVION.states.values()])
    errors = []
    for size in (1e-2, 1e-3):
        difference = (flown(np.array(point.states) + size * start) - states)[-1] / size
        found = predicted(along.A), predicted(along.A[:1].repeat(121, 0))
        errors.append([np.abs((each - difference) / sizes).max() for each in found])
    (first, frozen), (second, _) = errors
    assert second < 0.2 * first < 0.1 * frozen


def test_one_model_is_that_of_python_control() -> None:
    model = F16.with_parameters(xcg=0.3)
    x, u = np.array(trimmed(model).states) + 0.01, np.array([0.2, -1.5, 0.5, 0.5])
    along, peer = models_along(model, x, u), control.linearize(model.to_control(), x, u)
    np.testing.assert_allclose(along.A[0], peer.A, rtol=1e-4, atol=2e-3)
    np.testing.assert_allclose(along.B[0], peer.B, rtol=1e-4, atol=2e-3)
    x[0] = 0.0
    with pytest.raises(BadInputError, match="state 0 of the flight: F-16: "):
        models_along(model, x, u)
    with pytest.raises(BadInputError, match=r"must be \(N, 13\) and \(N, 4\)"):
        models_along(model, x, u[:3])
