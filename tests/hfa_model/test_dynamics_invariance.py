"""Invariance of the equations: units, a common scale of mass, and a very stiff hinge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from random_points import RATE_SCALES, random_points

import hfa
import hfa_model
from hfa import TrimCondition, linearize, trim
from hfa.paper import level_flight
from hfa_aircraft.model import Model
from hfa_model import STATES, VARIANTS, Input, Parameters, State
from hfa_model.aerodynamics import aircraft_loads
from hfa_model.atmosphere import density
from hfa_model.dynamics import rates_from_loads
from hfa_model.parameters import FIELDS
from hfa_model.variants import Variant
from hfa_model.vectors import INPUT_UNITS, STATE_UNITS
from trim import release
from trim.hfa.printed import eigenvalue_errors

RATE_UNITS = tuple(map(hfa.aircraft().rate_unit, STATES))


def unit_size(unit: str, length: float, mass: float, time: float) -> float:
    """Return the number of new units in one old unit.

    unit: a unit as in `FIELDS` and `vectors.py`
    length, mass, time: number of new units in a foot, a slug and a second
    """
    base = {
        "ft": length,
        "slug": mass,
        "s": time,
        "lbf": mass * length / time**2,
        "rad": 1.0,
        "1": 1.0,
    }
    above, _, below = unit.partition("/")
    size = 1.0
    for text, sign in ((above, 1), (below, -1)):
        for word in text.split():
            name, _, power = word.partition("^")
            size *= base[name] ** (sign * int(power or 1))
    return size


def change_of_units_error(
    variant: Variant, parameters: Parameters, fields: Parameters, *new: float
) -> float:
    """Return the largest relative error of the rates after conversion to other units.

    fields: declared units of the parameters
    new: number of new units in a foot, a slug and a second
    """

    def converted(values: Any, units: Any) -> list[float]:
        return [value * unit_size(unit, *new) for value, unit in zip(values, units, strict=True)]

    p = Parameters(*converted(parameters, [field.unit for field in fields]))
    worst = 0.0
    for state, control in zip(*random_points(50, seed=7), strict=True):
        air = density(state[2])
        x = State(*state.tolist())
        u = Input(*control.tolist())
        before = rates_from_loads(
            x, aircraft_loads(x, u, air, parameters, variant), parameters, variant
        )
        x = State(*converted(x, STATE_UNITS))
        u = Input(*converted(u, INPUT_UNITS))
        loads = aircraft_loads(x, u, air * unit_size("slug/ft^3", *new), p, variant)
        after = np.array(rates_from_loads(x, loads, p, variant))
        expected = np.array(converted(before, RATE_UNITS))
        scales = np.array(converted(RATE_SCALES, RATE_UNITS))
        worst = max(
            worst, float((np.abs(after - expected) / np.maximum(np.abs(expected), scales)).max())
        )
    return worst


SI = (0.3048, 14.593902937206364, 1.0)
SI_WITH_MINUTES = (0.3048, 14.593902937206364, 1 / 60)


@pytest.mark.parametrize("new", [SI, SI_WITH_MINUTES])
@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_units_do_not_change_the_physics(
    parameters: Parameters, variant: Variant, new: tuple[float, float, float]
) -> None:
    """The state derivatives are unchanged if mass, length and time have other units."""
    assert change_of_units_error(variant, parameters, FIELDS, *new) <= 1e-12


# Changes that linear models do not show: a common scale of mass, and chord versus coefficients.


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


# The rigid limit.


def test_a_stiff_hinge_gives_the_rigid_aircraft(aircraft: Model) -> None:
    """With hinge stiffness k, four eigenvalues differ from those of the rigid aircraft by order
    1/k."""
    elastic = release(
        level_flight(0.0), free=("alpha",), hold={"aileron_outer": 0.0, "elevator_outer": -0.05}
    )
    # Without the hinge there are three equations for three unknowns: alpha, throttle and the center
    # elevator.
    unhinged = {name: 0.0 for name in hfa.aircraft().steady if name != "dihedral_rate"}
    rigid_point = trim(aircraft, TrimCondition(hfa.aircraft(), elastic.imposed, unhinged))
    rigid = linearize(aircraft, rigid_point).select(("speed", "alpha", "pitch", "pitch_rate"))
    reference = np.linalg.eigvals(rigid.A)
    errors = []
    for stiffness in (1e10, 1e11, 1e12):
        stiff = hfa.aircraft(
            hfa_model.variant_of(aircraft),
            hfa_model.parameters_of(aircraft)._replace(hinge_stiffness=stiffness),
        )
        model = linearize(stiff, trim(stiff, release(elastic, free=("dihedral",))))
        errors.append(float(eigenvalue_errors(np.linalg.eigvals(model.A), reference).max()))
    orders = np.log10(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 2e-4
    np.testing.assert_allclose(orders, 1.0, atol=0.02)
