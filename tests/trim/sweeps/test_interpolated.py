"""Interpolated linear models compared with exact ones."""

from __future__ import annotations

import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from c_files import COMPILER, needs_gcc

import hfa
from hfa import sweep
from hfa.paper import level_model
from trim import InterpolatedModel

GRID = {"dihedral": np.radians([0.0, 5.0, 10.0, 15.0]), "speed": np.array([60.0, 68.0, 76.0])}


@pytest.fixture(scope="module")
def model() -> InterpolatedModel:
    return InterpolatedModel(sweep(hfa.aircraft(), GRID))


def test_models_are_exact_at_breakpoints_and_bilinear_between(model: InterpolatedModel) -> None:
    """The interpolated model is the exact one at breakpoints and bilinear between them.

    The values are given by name, in any order.
    """
    exact = level_model(hfa.aircraft(), float(GRID["dihedral"][2]))
    here = model.at(dihedral=GRID["dihedral"][2], speed=68.0)
    np.testing.assert_allclose(here.A, exact.A, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(here.inputs, exact.input_offsets, rtol=1e-9, atol=1e-12)
    ends = [
        model.at(dihedral=eta, speed=speed).B
        for eta in GRID["dihedral"][:2]
        for speed in (60.0, 68.0)
    ]
    between = model.at(speed=66.0, dihedral=np.radians(1.25)).B
    weights = np.outer([0.75, 0.25], [0.25, 0.75]).ravel()
    np.testing.assert_allclose(
        between, sum(w * B for w, B in zip(weights, ends, strict=True)), rtol=1e-12
    )


@needs_gcc
def test_exported_c_equals_the_interpolated_model(model: InterpolatedModel, folder: Path) -> None:
    """The generated C code gives the product's interpolated model at random and grid points.

    Beyond the grid, A equals A at the nearest end of the grid.
    """
    model.to_casadi().generate("models.c")
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-o", "models.so", "models.c", "-lm"], check=True
    )
    function = ca.external("models", "./models.so")
    rng = np.random.default_rng(4)
    eta = GRID["dihedral"]
    places = [
        *zip(rng.uniform(0, eta[-1], 20), rng.uniform(60, 76, 20), strict=True),
        (eta[1], 68.0),
        (eta[-1], 76.0),
    ]
    for dihedral, speed in places:
        expected = model.at(dihedral=dihedral, speed=speed)
        for in_c, values in zip(function([dihedral, speed]), expected, strict=True):
            in_shape = np.array(in_c).reshape(values.shape)
            np.testing.assert_allclose(in_shape, values, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(function([0.5, 80.0])[2], function([eta[-1], 76.0])[2])
