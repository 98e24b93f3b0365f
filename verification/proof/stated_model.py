"""What a certificate says about the trims and the linear model of one box, in doubles that are rounded outward."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb

from trim.point.condition import SCALES
from verification.arithmetic.balls import exact
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.dihedral_box import radians
from verification.enclosures.trim_branch import ModelForms, TrimBranch

#: Entries are stated this much wider than proved, so that another enclosure, a little wider, agrees with it.
_WIDER = 1.5
#: ... where the parameters have errors: products of errors are enclosed in another way there.
_WIDER_WITH_ERRORS = 4.0
#: ... and by this part of the largest entry of their row, which those that cancel to 0 need.
_FLOOR = 1e-6
#: The part of Lagrange's remainder that is added to the third-order term at the middle: room for the fourth order.
_BEYOND = 0.1
#: Part of an input that the rounding of what was read may move it by.
_READING = 1e-14
#: Part of what is seen of products of the parameters' errors that the radius of a trim allows for.
_AROUND = 0.6
#: Decimals of a trim at one angle, and its least radius in units of the variable.
_DIGITS, _FINEST = 55, 1e-46
#: Least radius of a trim in units of the input, over the cube of the box's radius in radians: an enclosure sees sizes
#: of terms, not that they cancel.
_LEAST = 10.0


@dataclass(frozen=True, eq=False)
class StatedModel:
    """A: (6, 6, 2), B: (6, 5, 2): lowest and highest value of each entry on the box.

    trim: unknown -> (c_0, c_1, c_2, radius, z_1, ..). The unknown is sought within its radius of c_0 + c_1 s + c_2 s²
    + Σ z_k t_k, s from -1 to 1 over the box, t the errors of the parameters in their half widths; whoever checks the
    certificate proves it (the prover's own enclosure is Lagrange's, which is wider).
    """

    trim: dict[str, list[float]]
    A: np.ndarray
    B: np.ndarray


def stated(model: ModelForms, free: tuple[str, ...]) -> StatedModel:
    """The statement of a box, from its Taylor models."""
    angle, trim = float(radians(model.box.radius)), {}
    for i, name in enumerate(free):
        *parts, remainder = (each[i, 0] for each in model.unknowns.parts[:4])
        slopes = [each[i, 0] for each in model.unknowns.parts[4:]]
        rest = 6 * abs(model.next_unknowns[i]).upper() + _BEYOND * abs(remainder).upper()
        reading = 10 * parts[0].rad() + _READING * abs(parts[0].mid())
        around = _AROUND * sum((slope.rad() for slope in slopes), exact(0.0))
        radius = float(rest + reading + around) + _LEAST * angle**3 * SCALES[name]
        trim[name] = [*(float(c.mid()) for c in parts), radius, *(float(slope.mid()) for slope in slopes)]
    return StatedModel(trim, _ends(model.A), _ends(model.B))


def stated_point(degrees: float, branch: TrimBranch) -> dict[str, Any]:
    """What a certificate says of the trim at one dihedral, degrees, with more decimals than a double has."""
    found = dict(zip(branch.free, branch.trim_at(degrees), strict=True))
    return {
        "dihedral_deg": [degrees, degrees],
        "decimals": branch.family.decimals,
        "trim": {
            name: [value.mid().str(_DIGITS, radius=False), 0.0, 0.0, 2 * float(value.rad()) + _FINEST * SCALES[name]]
            for name, value in found.items()
        },
    }


def _ends(form: TaylorModel) -> np.ndarray:
    rows, wider = form.range().tolist(), _WIDER_WITH_ERRORS if form.parts[4:] else _WIDER
    floors = [_FLOOR * max(abs(float(entry.mid())) for entry in row) for row in rows]
    return np.array([[_outward(entry, wider, floor) for entry in row] for row, floor in zip(rows, floors, strict=True)])


def _outward(ball: arb, wider: float, floor: float) -> tuple[float, float]:
    middle, half = float(ball.mid()), wider * float(ball.rad()) + floor
    low, high = middle - half, middle + half
    if not (exact(low) <= ball <= exact(high)):
        raise ArithmeticError("an enclosure was not rounded outward")
    return low, high
