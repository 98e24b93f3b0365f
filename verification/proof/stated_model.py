"""What a certificate says about the trims and the linear model of one box, in doubles that are rounded outward."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb

from verification.arithmetic.balls import exact
from verification.arithmetic.taylor_model import TaylorModel
from verification.enclosures.eigenvalue_signs import roomy
from verification.enclosures.trim_branch import Family, ModelForms, TrimBranch

#: Entries are stated this much wider than proved, so that another enclosure, a little wider, agrees with it.
_WIDER = 1.5
#: ... where the parameters have errors: products of errors are enclosed in another way there.
_WIDER_WITH_ERRORS = 4.0
#: ... and by this part of the largest entry of their row, which those that cancel to 0 need.
_FLOOR = 1e-6
#: A trim is sought within so many times, and the root of the number of unknowns, of what the equations leave along the
#: stated polynomial, in Newton's steps.
_ROOM = 1.5
#: Decimals of a trim at one angle, and its least radius in units of the variable.
_DIGITS, _FINEST = 55, 1e-46


@dataclass(frozen=True, eq=False)
class StatedModel:
    """A: (n, n, 2), B: (n, m, 2): lowest and highest value of each entry on the box.

    trim: unknown -> (c_0, c_1, c_2, radius, z_1, ..). The unknown is sought within its radius of c_0 + c_1 s + c_2 s²
    + Σ z_k t_k, s from -1 to 1 over the box, t the errors of the parameters in their half widths; whoever checks the
    certificate proves it (the prover's own enclosure is Lagrange's, which is wider).
    """

    trim: dict[str, list[float]]
    A: np.ndarray
    B: np.ndarray


def stated(model: ModelForms, family: Family) -> StatedModel:
    """The statement of a box, from its Taylor models."""
    signals, trim = family.model.signals, {}
    for name, step, row in zip(family.condition().free, model.steps, model.polynomials, strict=True):
        c0, c1, c2, *slopes = row
        trim[name] = [c0, c1, c2, _ROOM * math.sqrt(len(model.steps)) * step + _FINEST * signals[name].nominal, *slopes]
    return StatedModel(trim, _ends(model.A), _ends(model.B))


def stated_point(place: float, branch: TrimBranch) -> dict[str, Any]:
    """What a certificate says of the trim at one place, with more decimals than a double has."""
    found, signals = dict(zip(branch.free, branch.trim_at(place), strict=True)), branch.family.model.signals
    return {
        "range": [place, place],
        "decimals": branch.family.decimals,
        "trim": {
            name: [
                value.mid().str(_DIGITS, radius=False),
                0.0,
                0.0,
                2 * float(value.rad()) + _FINEST * signals[name].nominal,
            ]
            for name, value in found.items()
        },
    }


def _ends(form: TaylorModel) -> np.ndarray:
    rows, wider = roomy(form).range().tolist(), _WIDER_WITH_ERRORS if form.parts[4:] else _WIDER
    floors = [_FLOOR * max(abs(float(entry.mid())) for entry in row) for row in rows]
    rest = [[_ROOM * float(abs(entry).upper()) for entry in row] for row in form.parts[3].tolist()]
    return np.array(
        [
            [_outward(entry, wider, floor + more) for entry, more in zip(row, mores, strict=True)]
            for row, mores, floor in zip(rows, rest, floors, strict=True)
        ]
    )


def _outward(ball: arb, wider: float, floor: float) -> tuple[float, float]:
    middle, half = float(ball.mid()), wider * float(ball.rad()) + floor
    low, high = middle - half, middle + half
    if not (exact(low) <= ball <= exact(high)):
        raise ArithmeticError("an enclosure was not rounded outward")
    return low, high
