"""A to F of the flexible aircraft, compared with the equations at random states far from a trim.

The comparison uses high-order differences, row by row.
"""

import numpy as np
from random_points import (
    INPUT_SCALES,
    STATE_SCALES,
    WINDS,
    equations,
    random_points,
    wind_of,
)

import hfa
import hfa_model
from hfa_model import STATES, Input, State

NAMES = WINDS
WATCHED = tuple(hfa.aircraft().outputs)
ROWS = (*STATES, *WATCHED)
#: Size of a step of 1, in the units of states, inputs and winds.
SCALES = np.array([*STATE_SCALES, *INPUT_SCALES, *np.full(len(NAMES), 10.0)])
TROPOPAUSE = 36_152.0  # ft


def points(count, seed):
    """Return random states, inputs and zero winds, (count, 12 + winds).

    Altitudes near the nonsmooth point of the density at the tropopause are moved by 1000 ft.
    """
    states, inputs = random_points(count, seed)
    altitude = np.clip(states[:, 2], 500.0, 64_500.0)
    altitude[np.abs(altitude - TROPOPAUSE) < 500.0] += 1000.0
    states[:, 2] = altitude
    return np.hstack([states, inputs, np.zeros((count, len(NAMES)))])


def at(aircraft, z):
    """Return rates and outputs of the aircraft at z, computed by the equations with numbers.

    z: states (7), inputs (5), winds
    """
    rates, outputs = equations(
        State(*z[:7].tolist()),
        Input(*z[7:12].tolist()),
        hfa_model.parameters_of(aircraft),
        hfa_model.variant_of(aircraft),
        wind_of(z[12:].tolist()),
    )
    rows = (*(rates[name] for name in STATES), *(outputs[name] for name in WATCHED))
    return np.array(rows, dtype=float)


def blocks(aircraft, z):
    """Return the linear model [A B E; C D F], with each column multiplied by the step in
    `SCALES`.
    """
    exact = aircraft.at(z[:7], z[7:12], WATCHED, NAMES)
    return np.block([[exact.A, exact.B, exact.E], [exact.C, exact.D, exact.F]]) * SCALES


def test_derivatives_equal_high_order_differences(aircraft):
    """A to F, the derivatives of rates and outputs by states, inputs and winds, agree with eighth-order
    central differences to 1e-10 of the largest entry of a row.
    """
    weights = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}  # of f(z + k h) - f(z - k h)
    for z in points(6, seed=12):
        exact = blocks(aircraft, z)
        columns = []
        width = 0.005
        for step in np.diag(width * SCALES):
            ahead = [at(aircraft, z + k * step) for k in weights]
            back = [at(aircraft, z - k * step) for k in weights]
            columns.append(np.array(list(weights.values())) @ np.subtract(ahead, back) / width)
        sizes = np.maximum(np.abs(exact).max(axis=1), 1e-2 * np.abs(at(aircraft, z)))
        errors = np.abs(np.column_stack(columns) - exact).max(axis=1)
        assert np.all(errors <= 1e-10 * sizes), ROWS[(errors / sizes).argmax()]
