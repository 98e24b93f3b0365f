"""What a certificate says about the trims and the linear model of one box, in doubles that are rounded outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from hfa_model.vectors import INPUT_SCALES
from verification.proof.balls import exact
from verification.proof.taylor import TaylorForm, radians
from verification.proof.trim_branch import ModelForms

if TYPE_CHECKING:
    from flint import arb

#: Entries are stated this much wider than proved, so that another enclosure, a little wider, agrees with it.
_WIDER = 1.5
#: ... and by this part of the largest entry of their row, which those that cancel to 0 need.
_FLOOR = 1e-6
#: The part of Lagrange's remainder that is added to the third-order term at the middle: room for the fourth order.
_BEYOND = 0.1
#: Part of an input that the rounding of what was read may move it by.
_READING = 1e-14
#: Least radius of a trim in units of the input, over the cube of the box's radius in radians: an enclosure sees sizes
#: of terms, not that they cancel.
_LEAST = 10.0


@dataclass(frozen=True, eq=False)
class StatedModel:
    """A: (6, 6, 2), B: (6, 5, 2): lowest and highest value of each entry on the box.

    trim: (5, 3), radius: (5,): U0(η) is sought within `radius` of trim · (1, τ, τ²), τ from the middle of the box in
    degrees; whoever checks the certificate proves it (the prover's own enclosure is Lagrange's, which is wider).
    """

    trim: np.ndarray
    radius: np.ndarray
    A: np.ndarray
    B: np.ndarray


def stated(model: ModelForms) -> StatedModel:
    """The statement of a box, from its Taylor forms."""
    cube, inputs = model.box.radius**3, model.inputs
    trim = [[float(each[i, 0].mid()) for each in inputs.coefficients] for i in range(inputs.last.nrows())]
    third = [6 * abs(each).upper() * cube for each in model.next_inputs]
    rests = [_BEYOND * abs(row[0]).upper() * cube for row in inputs.last.tolist()]
    reading = [10 * row[0].rad() + _READING * abs(row[0].mid()) for row in inputs.coefficients[0].tolist()]
    angle = float(radians(model.box.radius))
    radius = [
        float(sum(parts)) + _LEAST * angle**3 * scale
        for *parts, scale in zip(third, rests, reading, INPUT_SCALES, strict=True)
    ]
    return StatedModel(np.array(trim), np.array(radius), _ends(model.A), _ends(model.B))


def _ends(form: TaylorForm) -> np.ndarray:
    rows = form.range().tolist()
    floors = [_FLOOR * max(abs(float(entry.mid())) for entry in row) for row in rows]
    return np.array([[_outward(entry, floor) for entry in row] for row, floor in zip(rows, floors, strict=True)])


def _outward(ball: arb, floor: float) -> tuple[float, float]:
    middle, half = float(ball.mid()), _WIDER * float(ball.rad()) + floor
    low, high = middle - half, middle + half
    if not (exact(low) <= ball <= exact(high)):
        raise ArithmeticError("an enclosure was not rounded outward")
    return low, high
