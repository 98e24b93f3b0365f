"""The equations of motion, compared with rates of two other derivations and of MuJoCo, which are in
`derived_rates.npz`, with their states, inputs, parameters and winds: names begin with "newton",
"unsteady" and "mujoco".

The first two follow from energies alone, d/dt ∂T/∂r' - ∂T/∂r + ∂U/∂r = Q (Goldstein, Classical
Mechanics, Section 1.4), by `lagrangian.py` and `unsteady_energy.py` of commit 199915ecb, for random
parameters and winds. In T of "unsteady" is the energy of the air that wings and tails carry. It has no
effect, all effects, each effect alone, and random fractions of all effects. MuJoCo's rates, with
inertias that a body can have and without wind, were stored by `mujoco_bodies.py` of commit a9fd0d555.
"""

from pathlib import Path

import numpy as np
import pytest
from random_points import RATE_SCALES, rates_function

import hfa
from hfa_model import UNSTEADY

DERIVED = np.load(Path(__file__).with_name("derived_rates.npz"))


def disagreement(kind, aircraft):
    """Return the largest difference of each rate of an aircraft from the derived ones of a kind,
    relative to the rate or, near zero, to its scale.
    """
    points = zip(*(DERIVED[f"{kind} {name}"] for name in "xupw"), strict=True)
    rates = rates_function(aircraft.layout, lambda *at: aircraft.equations(*at)[0])
    found, expected = (
        np.array([rates(*point).full().ravel() for point in points]),
        DERIVED[f"{kind} rates"],
    )
    scales = [*RATE_SCALES, *np.ones(expected.shape[1] - len(RATE_SCALES))]
    return (np.abs(found - expected) / np.maximum(np.abs(expected), scales)).max(axis=0)


@pytest.mark.parametrize(
    ("kind", "aircraft", "most"),
    [
        ("newton", hfa.aircraft("newton"), 1e-11),
        ("mujoco", hfa.aircraft("newton"), 1e-8),
        ("unsteady", UNSTEADY, 1e-11),
    ],
)
def test_rates_equal_those_of_other_derivations(kind, aircraft, most):
    """The rates of "newton" and "unsteady" equal those that follow from energies, in wind, and those
    of "newton" MuJoCo's.
    """
    assert disagreement(kind, aircraft).max() <= most
