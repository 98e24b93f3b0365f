"""C, D, E and F by the Taylor remainder, beside A and B: of second order at trimmed points, in random directions."""

from __future__ import annotations

import numpy as np
import pytest
from known_models import model_at

from hfa_model import INPUTS, STATES, Aircraft, Input, State
from hfa_model.outputs import OUTPUTS, moment_of, outputs_of
from hfa_model.vectors import INPUT_SCALES, STATE_SCALES
from hfa_model.winds import DISTURBANCES, winds_named
from trim import LinearModel, OperatingPoint, linearize

NAMES, WATCHED = tuple(DISTURBANCES), tuple(OUTPUTS)
ROWS = (*(f"rate of {name}" for name in STATES), *WATCHED)
DIRECTIONS = 7
STEPS = np.array([4e-3, 2e-3, 1e-3])
#: Of a column of states, inputs and winds: what a step of 1 is, in their units.
SCALES = np.array([*STATE_SCALES, *INPUT_SCALES, *[10.0] * len(NAMES)])
#: A remainder below this share of the change itself is rounding: the row is linear.
LINEAR = 1e-11


def at(aircraft: Aircraft, point: np.ndarray, *, ground_drag: bool) -> np.ndarray:
    """Rates and outputs at states, inputs and winds, (7 + k,)."""
    winds = winds_named(NAMES, point[12:].tolist(), ground_drag=ground_drag)
    x, u = State(*point[:7].tolist()), Input(*point[7:12].tolist())
    moment = moment_of(x, u, aircraft.parameters, aircraft.variant, winds)
    return np.array([*moment.rates, *outputs_of(moment, WATCHED)], dtype=float)


def slopes(aircraft: Aircraft, model: LinearModel, blocks: np.ndarray, *, ground_drag: bool) -> np.ndarray:
    """Slope of log |f(z + h d) - f(z) - h J d| over log h, (directions, rows); 2 where nothing but rounding is left."""
    rng = np.random.default_rng(5)
    point = np.array([*model.point.states, *model.point.inputs, *[0.0] * len(NAMES)])
    here, found = at(aircraft, point, ground_drag=ground_drag), np.full((DIRECTIONS, len(blocks)), 2.0)
    for slope, direction in zip(found, rng.normal(size=(DIRECTIONS, len(point))) * SCALES, strict=True):
        change = blocks @ direction
        moved = [at(aircraft, point + h * direction, ground_drag=ground_drag) for h in STEPS]
        remainders = np.abs(moved - here - STEPS[:, None] * change)
        curved = remainders[-1] > LINEAR * np.maximum(np.abs(here), np.abs(change))
        slope[curved] = np.polyfit(np.log(STEPS), np.log(remainders[:, curved]), 1)[0]
    return found


@pytest.mark.parametrize("ground_drag", [False, True])
@pytest.mark.parametrize("degrees", [5.0, 15.0])
def test_the_remainder_of_every_row_is_of_second_order(aircraft: Aircraft, degrees: float, ground_drag: bool) -> None:
    point = model_at(degrees, aircraft.variant.name).point
    model = linearize(aircraft, point, full=True, outputs=WATCHED, disturbances=NAMES, ground_drag=ground_drag)
    blocks = np.block([[model.A, model.B, model.E], [model.C, model.D, model.F]])
    found = slopes(aircraft, model, blocks, ground_drag=ground_drag)
    assert found.min() >= 1.9, ROWS[found.min(axis=0).argmin()]
    typical = np.median(found, axis=0)  # in one direction the second order may cancel, and leave the third
    assert typical.max() <= 2.1, ROWS[typical.argmax()]


@pytest.mark.parametrize(
    ("row", "column"),
    [
        ("rate of pitch_rate", "headwind_outer"),  # E
        ("load_factor_outer", "alpha"),  # C
        ("hinge_moment", "elevator_outer"),  # D
        ("alpha_air_outer", "updraft_center"),  # F, where there should be nothing
        ("lift_outer", "updraft_outer"),
    ],
)
def test_one_wrong_entry_is_seen_in_its_row(
    published_aircraft: Aircraft, point: OperatingPoint, row: str, column: str
) -> None:
    model = linearize(published_aircraft, point, full=True, outputs=WATCHED, disturbances=NAMES)
    blocks = np.block([[model.A, model.B, model.E], [model.C, model.D, model.F]])
    at_row, at_column = ROWS.index(row), (*STATES, *INPUTS, *NAMES).index(column)
    blocks[at_row, at_column] += 1e-2 * np.abs(blocks[at_row] * SCALES).max() / SCALES[at_column]
    found = slopes(published_aircraft, model, blocks, ground_drag=False)
    assert found[:, at_row].min() < 1.5
    assert np.delete(found, at_row, axis=1).min() >= 1.9
