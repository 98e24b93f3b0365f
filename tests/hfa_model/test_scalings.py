"""Changes of parameters that linear models do not show."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import hfa
import hfa_model
from hfa import Model, linearize, trim
from hfa.paper import level_flight
from hfa_model import Parameters


def scaled(
    p: Parameters, factor: float, *, up: tuple[str, ...], down: tuple[str, ...]
) -> Parameters:
    changes = {name: getattr(p, name) * factor for name in up} | {
        name: getattr(p, name) / factor for name in down
    }
    return p._replace(**changes)


def heavier(p: Parameters, factor: float) -> Parameters:
    """Return the parameters with all masses and forces multiplied by `factor`.

    κ is divided by `factor`, because C_D = C_D0 + κ C_L².
    """
    inertias = ("panel_mass", "inertia_roll", "inertia_pitch", "inertia_yaw")
    coefficients = (
        "lift_slope",
        "aileron_lift",
        "aileron_moment",
        "zero_lift_moment",
        "zero_lift_drag",
    )
    others = ("hinge_stiffness", "hinge_damping", "thrust_per_throttle")
    return scaled(p, factor, up=(*inertias, *coefficients, *others), down=("induced_drag",))


def longer_chord(p: Parameters, factor: float) -> Parameters:
    """Return the parameters with a longer chord and the same products of area and coefficient.

    C_L and C_D0 are divided by `factor`, C_M by factor², and the tail area is multiplied by
    `factor`.
    """
    once = scaled(
        p,
        factor,
        up=("chord", "tail_area", "induced_drag"),
        down=("lift_slope", "aileron_lift", "zero_lift_drag", "aileron_moment", "zero_lift_moment"),
    )
    return scaled(once, factor, up=(), down=("aileron_moment", "zero_lift_moment"))


@pytest.mark.parametrize("change", [heavier, longer_chord])
def test_two_scalings_leave_a_and_b_unchanged(aircraft: Model, change: Any) -> None:
    """Two scalings of the parameters leave A and B unchanged. If the induced drag is not scaled, A
    changes.

    Therefore the identification must fix two parameters.
    """
    other_aircraft = hfa.aircraft(
        hfa_model.variant_of(aircraft), change(hfa_model.parameters_of(aircraft), 1.7)
    )
    condition = level_flight(float(np.radians(15.0)))
    first, second = (
        linearize(model, trim(model, condition), full=True) for model in (aircraft, other_aircraft)
    )
    for before, after in ((first.A, second.A), (first.B, second.B)):
        np.testing.assert_allclose(after, before, rtol=1e-12, atol=1e-12 * np.abs(before).max())
    forgotten = hfa.aircraft(
        hfa_model.variant_of(aircraft),
        hfa_model.parameters_of(other_aircraft)._replace(
            induced_drag=hfa_model.parameters_of(aircraft).induced_drag
        ),
    )
    assert (
        np.abs(linearize(forgotten, trim(forgotten, condition), full=True).A - first.A).max() > 1e-4
    )
