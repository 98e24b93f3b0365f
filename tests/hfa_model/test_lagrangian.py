"""The equations of motion, compared with a second derivation and with MuJoCo."""

import json
from functools import cache
from pathlib import Path

import numpy as np
from lagrangian import lagrangian_rates, winds_of
from random_points import RATE_SCALES, WINDS, equations, random_points, rates_function
from standard_air import density

import hfa
from hfa_model import STATES, State

LAYOUT = hfa.aircraft().layout


@cache
def euler_lagrange_rates():
    """Return the CasADi Function (x, u, p, w) -> dX/dt of the Euler-Lagrange equations."""
    return rates_function(
        LAYOUT,
        lambda x, u, p, w: lagrangian_rates(x, u, density(x.altitude), p, winds_of(w))._asdict(),
    )


@cache
def closed_form(dynamics):
    """Return the CasADi Function (x, u, p, w) -> dX/dt of a variant."""
    return rates_function(LAYOUT, lambda x, u, p, w: equations(x, u, p, dynamics, w)[0])


def disagreement(dynamics, parameters):
    """Return the largest difference of each rate between a variant and the Euler-Lagrange equations.

    Each difference is divided by the rate or, near zero, by the scale of the rate. 100 random states,
    inputs, winds and parameters (20 % standard deviation) are used.
    """
    random = np.random.default_rng(5)
    spread = random.normal(size=(100, len(parameters))) * 0.2
    winds = random.uniform(-15, 15, (100, len(WINDS)))
    worst = np.zeros(len(STATES))
    for state, control, noise, wind in zip(*random_points(100, seed=4), spread, winds, strict=True):
        point = (state, control, np.array(parameters) * np.exp(noise), wind)
        expected = np.array(euler_lagrange_rates()(*point)).ravel()
        off = np.abs(np.array(closed_form(dynamics)(*point)).ravel() - expected)
        worst = np.maximum(worst, off / np.maximum(np.abs(expected), RATE_SCALES))
    return State(*worst.tolist())


def test_newton_equals_the_euler_lagrange_equations(parameters):
    """In wind, the rates of "newton" equal the Euler-Lagrange equations at random states."""
    assert max(disagreement("newton", parameters)) <= 1e-11


def test_published_differs_from_newton_in_two_equations_only(parameters):
    """The rates of "published" differ from the Euler-Lagrange equations only in q' and η''."""
    worst = disagreement("published", parameters)._asdict()
    assert worst.pop("pitch_rate") > 0.1
    assert worst.pop("dihedral_rate") > 0.1
    assert max(worst.values()) <= 1e-11, worst


# Rigid bodies.


def test_newton_equals_the_rigid_bodies_of_mujoco(parameters):
    """With inertias that a body can have, the rates of "newton" are MuJoCo's to 1e-8.

    MuJoCo's rates were stored by `mujoco_bodies.py` of commit a9fd0d555.
    """
    stored = json.loads(Path(__file__).with_name("mujoco_rates.json").read_text("utf-8"))
    p = np.array(parameters._replace(**stored["inertias"]))
    newton = closed_form("newton")
    for case in stored["cases"]:
        found = np.array(newton(case["x"], case["u"], p, np.zeros(len(WINDS)))).ravel()
        np.testing.assert_allclose(
            found / RATE_SCALES, case["rates"] / np.array(RATE_SCALES), rtol=1e-8, atol=1e-8
        )
