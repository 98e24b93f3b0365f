"""The equations of motion: judged by a second derivation, by energy, and by what the loads must do."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from random_points import random_points

from hfa_model.aerodynamics import aircraft_loads
from hfa_model.aircraft import Aircraft
from hfa_model.atmosphere import density
from hfa_model.dynamics import rates, rates_from_loads
from hfa_model.parameters import Parameters
from hfa_model.variants import VARIANTS, Newton, Published, Variant
from hfa_model.vectors import RATE_SCALES, STATES, Input, State
from trim.linear.linearize import linearize
from trim.point.condition import level_flight
from trim.point.solve import find_operating_point
from verification.physics.lagrangian import lagrangian_rates, mechanical_energy

DEGREES_15 = float(np.radians(15.0))


def symbols() -> tuple[Any, Any, Any]:
    """Column vectors of symbols for X, U and the parameters."""
    return ca.SX.sym("x", len(STATES)), ca.SX.sym("u", len(Input._fields)), ca.SX.sym("p", len(Parameters._fields))


def named(x: Any, u: Any, p: Any) -> tuple[State, Input, Parameters]:
    return State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), Parameters(*ca.vertsplit(p))


# The judge: Euler-Lagrange equations.


@pytest.fixture(scope="module")
def judge() -> ca.Function:
    """(x, u, p) -> dX/dt by the Euler-Lagrange equations."""
    x, u, p = symbols()
    state, control, parameters = named(x, u, p)
    return ca.Function(
        "judge", [x, u, p], [ca.vertcat(*lagrangian_rates(state, control, density(state.altitude), parameters))]
    )


def disagreement(judge: ca.Function, variant: Variant, parameters: Parameters, count: int = 1000) -> State:
    """Largest |difference| of each rate over random points, relative to the rate or, near zero, to its scale.

    The parameters vary too, by some 20 percent each.
    """
    x, u, p = symbols()
    closed_form = ca.Function("closed_form", [x, u, p], [ca.vertcat(*rates(*named(x, u, p), variant))])
    spread = np.random.default_rng(5).normal(size=(count, len(parameters))) * 0.2
    worst = np.zeros(len(STATES))
    for state, control, noise in zip(*random_points(count, seed=4), spread, strict=True):
        aircraft = np.array(parameters) * np.exp(noise)
        expected = np.array(judge(state, control, aircraft)).ravel()
        found = np.array(closed_form(state, control, aircraft)).ravel()
        worst = np.maximum(worst, np.abs(found - expected) / np.maximum(np.abs(expected), RATE_SCALES))
    return State(*worst.tolist())


def test_newton_equals_the_euler_lagrange_equations(judge: ca.Function, parameters: Parameters) -> None:
    worst = disagreement(judge, Newton(), parameters)
    assert max(worst) <= 1e-12, worst


class _WrongCoupling(Newton):
    def hinge_coupling(self, x: State, p: Parameters) -> Any:
        return -super().hinge_coupling(x, p)


class _WrongInertia(Newton):
    def hinge_inertia(self, dihedral: Any, p: Parameters) -> Any:
        return super().hinge_inertia(dihedral, p) * (1 + 1e-9)


class _WrongLever(Newton):
    def outer_lever(self, dihedral: Any, p: Parameters) -> Any:
        return -super().outer_lever(dihedral, p)


class _WrongProjection(Newton):
    def section_projection(self, dihedral: Any) -> Any:
        return 1.0


@pytest.mark.parametrize(
    ("variant", "rate"),
    [
        (_WrongCoupling(), "dihedral_rate"),
        (_WrongInertia(), "dihedral_rate"),
        (_WrongLever(), "pitch_rate"),
        (_WrongProjection(), "pitch_rate"),
    ],
)
def test_one_wrong_term_is_seen_in_its_equation(
    judge: ca.Function, parameters: Parameters, variant: Variant, rate: str
) -> None:
    worst = disagreement(judge, variant, parameters, count=20)._asdict()
    assert worst.pop(rate) > 1e-10
    assert max(worst.values()) <= 1e-12, worst


def test_published_differs_from_newton_in_two_equations_only(judge: ca.Function, parameters: Parameters) -> None:
    worst = disagreement(judge, Published(), parameters, count=100)._asdict()
    assert worst.pop("pitch_rate") > 0.1
    assert worst.pop("dihedral_rate") > 0.1
    assert max(worst.values()) <= 1e-12, worst


# Energy.


def internal_energy(state: np.ndarray, p: Parameters) -> float:
    """½ (c1 + c2 sin² η) q² + (I_x3x3 + m s²/4 - (m s²/6) cos² η) η'² + k η²: energy about the center of mass."""
    x = State(*state.tolist())
    mass_moment = p.panel_mass * p.panel_span**2
    pitch_inertia = 3 * p.inertia_pitch
    pitch_inertia += (2 * p.inertia_yaw - 2 * p.inertia_pitch + mass_moment / 6) * np.sin(x.dihedral) ** 2
    hinge_inertia = p.inertia_roll + mass_moment / 4 - mass_moment / 6 * np.cos(x.dihedral) ** 2
    return float(
        pitch_inertia * x.pitch_rate**2 / 2 + hinge_inertia * x.dihedral_rate**2 + p.hinge_stiffness * x.dihedral**2
    )


def energy_growth(variant: Variant, parameters: Parameters, seconds: float) -> float:
    """Largest relative change of the internal energy in a fall without air and without dampers."""
    from scipy.integrate import solve_ivp

    p = parameters._replace(hinge_damping=0.0)
    symbol = ca.SX.sym("x", len(STATES))
    x = State(*ca.vertsplit(symbol))
    loads = aircraft_loads(x, Input(0.0, 0.0, 0.0, 0.0, 0.0), 0.0, p, variant)
    motion = ca.Function("motion", [symbol], [ca.vertcat(*rates_from_loads(x, loads, p, variant))])
    start = State(
        speed=68.0, alpha=0.05, altitude=40_000.0, pitch=0.05, pitch_rate=0.3, dihedral=0.26, dihedral_rate=0.2
    )
    flight = solve_ivp(
        lambda _, state: np.array(motion(state)).ravel(),
        (0.0, seconds),
        start,
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
    )
    assert flight.success, flight.message
    energy = np.array([internal_energy(state, p) for state in flight.y.T])
    return float(np.abs(energy / energy[0] - 1).max())


def test_newton_conserves_energy_in_free_flight(parameters: Parameters) -> None:
    assert energy_growth(Newton(), parameters, seconds=20.0) <= 1e-10


def test_published_makes_energy_out_of_nothing(parameters: Parameters) -> None:
    """The departures of the published equations from Newton are not only a matter of taste."""
    assert energy_growth(Published(), parameters, seconds=2.0) > 1.0


def test_energy_of_the_judge_is_internal_plus_center_of_mass(parameters: Parameters) -> None:
    """König's theorem: T + U = internal energy + ½ (3 m) V² + 3 m g h."""
    symbol = ca.SX.sym("x", len(STATES))
    energy = ca.Function("energy", [symbol], [mechanical_energy(State(*ca.vertsplit(symbol)), parameters)])
    for state in random_points(50, seed=6)[0]:
        x = State(*state.tolist())
        mass = 3 * parameters.panel_mass
        whole = mass * x.speed**2 / 2 + mass * parameters.gravity * x.altitude + internal_energy(state, parameters)
        assert float(energy(state)) == pytest.approx(whole, rel=1e-12)


# Floats and expressions, loads, and signs.


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_floats_and_expressions_give_the_same(parameters: Parameters, variant: Variant) -> None:
    compiled = Aircraft(parameters, variant)
    for state, control in zip(*random_points(50, seed=8), strict=True):
        plain = rates(State(*state.tolist()), Input(*control.tolist()), parameters, variant)
        assert all(isinstance(value, float) for value in plain)
        np.testing.assert_allclose(compiled.rates(state, control), plain, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("degrees", [0.0, 5.0, 15.0, 20.0])
def test_loads_at_trim_are_those_of_steady_flight(aircraft: Aircraft, degrees: float) -> None:
    """L + T sin α = W, D = T cos α, M = 0, H = k η, all from `loads` alone; lift and drag are positive."""
    point = find_operating_point(aircraft, level_flight(float(np.radians(degrees))))
    loads, p = aircraft.loads(np.array(point.states), np.array(point.inputs)), aircraft.parameters
    weight = 3 * p.panel_mass * p.gravity
    assert min(loads.lift, loads.drag, loads.center.lift, loads.outer.lift, loads.center.drag, loads.outer.drag) > 0
    assert loads.lift + loads.thrust * np.sin(point.states.alpha) == pytest.approx(weight, rel=1e-12)
    assert loads.thrust * np.cos(point.states.alpha) == pytest.approx(loads.drag, rel=1e-12)
    assert loads.pitching_moment == pytest.approx(0.0, abs=1e-9 * weight * p.boom_length)
    # Level and steady: nothing else acts on the hinge.
    assert loads.hinge_moment == pytest.approx(p.hinge_stiffness * point.states.dihedral, abs=1e-6)


def test_loads_give_the_rates(aircraft: Aircraft) -> None:
    """Forces and moments of `loads` against the accelerations of `rates`, away from trim."""
    p = aircraft.parameters
    for state, control in zip(*random_points(50, seed=9), strict=True):
        x, found, loads = State(*state), State(*aircraft.rates(state, control)), aircraft.loads(state, control)
        gamma = x.pitch - x.alpha
        drag_force = loads.thrust * np.cos(x.alpha) - loads.drag
        assert found.speed == pytest.approx(drag_force / (3 * p.panel_mass) - p.gravity * np.sin(gamma), rel=1e-10)
        pitch_inertia = 3 * p.inertia_pitch
        growth = 2 * p.inertia_yaw - 2 * p.inertia_pitch + p.panel_mass * p.panel_span**2 / 6
        pitch_inertia += growth * np.sin(x.dihedral) ** 2
        momentum_change = growth * np.sin(2 * x.dihedral) * x.dihedral_rate * x.pitch_rate
        assert pitch_inertia * found.pitch_rate + momentum_change == pytest.approx(loads.pitching_moment, rel=1e-9)


def test_controls_act_in_the_right_direction(aircraft: Aircraft) -> None:
    """More thrust speeds up; trailing edge down on the tail pitches down, on the outer wings raises the tips."""
    model = linearize(aircraft, find_operating_point(aircraft, level_flight(DEGREES_15)), full=True)
    effect = {(s, u): model.B[i, j] for i, s in enumerate(model.states) for j, u in enumerate(model.inputs)}
    assert effect["speed", "throttle"] > 0
    assert effect["pitch_rate", "elevator_center"] < 0
    assert effect["pitch_rate", "elevator_outer"] < 0
    assert effect["dihedral_rate", "aileron_outer"] > 0
    assert effect["alpha", "aileron_center"] < 0
