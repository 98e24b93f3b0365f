"""Trims at the edges of what there is: a Jacobian without full rank, wings at 0 and nearly 90 degrees, no air."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import Aircraft, Input, Parameters, State
from hfa_model.aerodynamics import aircraft_loads
from hfa_model.dynamics import rates_from_loads
from hfa_model.variants import VARIANTS, Variant
from hfa_support import BadInputError
from trim import TrimError, find_operating_point, level_flight, release

UPRIGHT = {"dihedral": (-np.pi / 2, np.pi / 2)}


def test_a_control_that_moves_nothing_is_named(aircraft: Aircraft) -> None:
    """Ailerons without effect leave a column of zeros."""
    without = aircraft.parameters._replace(aileron_lift=0.0, aileron_moment=0.0)
    condition = level_flight(float(np.radians(15.0)))
    with pytest.raises(TrimError, match=r"no trim: .*; aileron_outer moves none of them, set something else free\)"):
        find_operating_point(Aircraft(without, aircraft.variant), condition)
    with pytest.raises(TrimError) as refusal:
        find_operating_point(aircraft, release(condition, hold={"aileron_outer": 0.3}))
    assert "moves none" not in str(refusal.value)


def test_controls_that_cannot_be_told_apart_are_named(aircraft: Aircraft) -> None:
    """Tails that are small and far away only pitch: the outer ones can do nothing that the center one cannot."""
    p = aircraft.parameters
    far = p._replace(tail_area=p.tail_area * 1e-14, boom_length=p.boom_length * 1e14)
    alike = Aircraft(far, aircraft.variant)
    condition = level_flight(float(np.radians(15.0)))
    same = "elevator_outer moves them only as elevator_center does; set something else free"
    with pytest.raises(TrimError, match=rf"^no trim: .*; {same}\); 8 other starts failed too$"):
        find_operating_point(alike, condition)
    find_operating_point(alike, release(condition, free=("aileron_center",), hold={"elevator_outer": 0.0}))


@pytest.mark.parametrize("degrees", [0.0, 89.9999, -89.9999])
def test_level_and_nearly_upright_wings_are_trimmed(aircraft: Aircraft, degrees: float) -> None:
    condition = release(level_flight(float(np.radians(degrees)), limits=UPRIGHT), free=("alpha",))
    point = find_operating_point(aircraft, condition)
    assert max(map(abs, point.residuals.values())) <= 1e-12
    assert np.isfinite(aircraft.model.at(point.states, point.inputs).A).all()


@pytest.mark.parametrize("degrees", [90.0, -90.0])
def test_upright_wings_are_refused(aircraft: Aircraft, degrees: float) -> None:
    condition = level_flight(float(np.radians(degrees)), limits=UPRIGHT)
    with pytest.raises(BadInputError, match=f"dihedral is {degrees:g} deg; it must be above -90 and below 90 deg"):
        find_operating_point(aircraft, condition)


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
@pytest.mark.parametrize("dihedral", [0.0, np.pi / 2])
def test_without_air_it_falls(parameters: Parameters, variant: Variant, dihedral: float) -> None:
    """No density, no load: V' = -g sin γ and V γ' = -g cos γ, whatever the controls do."""
    x = State(68.0, 0.05, 40_000.0, 0.3, 0.1, dihedral, 0.0)
    loads = aircraft_loads(x, Input(0.0, 0.1, -0.1, 0.2, -0.2), 0.0, parameters, variant)
    assert (loads.lift, loads.drag, loads.pitching_moment) == (0.0, 0.0, 0.0)
    rates, gamma = rates_from_loads(x, loads, parameters, variant), x.pitch - x.alpha
    assert rates.speed == pytest.approx(-parameters.gravity * np.sin(gamma), rel=1e-14)
    gamma_rate = rates.pitch - rates.alpha
    assert gamma_rate == pytest.approx(-parameters.gravity * np.cos(gamma) / x.speed, rel=1e-14)
    assert rates.pitch_rate == 0.0
