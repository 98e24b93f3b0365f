"""Wind at each panel: against the Euler-Lagrange equations, seen from the ground, and the uniform updraft."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from lagrangian import lagrangian_rates
from random_points import RATE_SCALES, random_points, rates, state_rates, symbols

from hfa_model import STATES, VARIANTS, Input, Parameters, State, kinematics
from hfa_model.atmosphere import density
from hfa_model.kinematics import DISTURBANCES, Wind, Winds, winds_named
from hfa_model.variants import Newton, Variant

NAMES = tuple(DISTURBANCES)


def points(count: int, seed: int) -> list[tuple[State, Input, np.ndarray]]:
    """Random states, inputs and values of all named winds, ft/s."""
    rng = np.random.default_rng(seed)
    states, inputs = random_points(count, seed)
    return [
        (State(*x.tolist()), Input(*u.tolist()), rng.uniform(-15.0, 15.0, len(NAMES)))
        for x, u in zip(states, inputs, strict=True)
    ]


def derived_again(parameters: Parameters, *, ground_drag: bool) -> ca.Function:
    """(x, u, w) -> dX/dt by the Euler-Lagrange equations."""
    (x, u, _), w = symbols(), ca.SX.sym("w", len(NAMES))
    state, winds = State(*ca.vertsplit(x)), winds_named(NAMES, ca.vertsplit(w), ground_drag=ground_drag)
    found = lagrangian_rates(state, Input(*ca.vertsplit(u)), density(state.altitude), parameters, winds)
    return ca.Function("judge", [x, u, w], [ca.vertcat(*found)])


def disagreement(judge: ca.Function, parameters: Parameters, *, ground_drag: bool) -> float:
    """Largest difference of a rate of `newton`, relative to the rate or, near zero, to its scale."""
    worst = 0.0
    for x, u, w in points(100, seed=3):
        expected = np.array(judge(ca.DM(list(x)), ca.DM(list(u)), w)).ravel()
        winds = winds_named(NAMES, w.tolist(), ground_drag=ground_drag)
        error = np.abs(np.array(rates(x, u, parameters, Newton(), winds)) - expected)
        worst = max(worst, float((error / np.maximum(np.abs(expected), RATE_SCALES)).max()))
    return worst


@pytest.mark.parametrize("ground_drag", [False, True])
def test_newton_in_wind_equals_the_euler_lagrange_equations(
    parameters: Parameters, ground_drag: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    judge = derived_again(parameters, ground_drag=ground_drag)
    assert disagreement(judge, parameters, ground_drag=ground_drag) <= 1e-11
    assert disagreement(judge, parameters, ground_drag=not ground_drag) > 1e-3

    def from_the_wrong_side(x: State, p: Parameters, winds: Winds) -> kinematics.Flow:
        wind = winds.outer
        return kinematics.outer_flow(x, p, winds._replace(outer=wind._replace(outward=-wind.outward)))

    monkeypatch.setattr("hfa_model.aerodynamics.outer_flow", from_the_wrong_side)
    assert disagreement(judge, parameters, ground_drag=ground_drag) > 1e-3


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
def test_a_uniform_updraft_is_the_same_wind_at_every_panel_to_the_bit(parameters: Parameters, variant: Variant) -> None:
    for x, u, (w, *_) in points(30, seed=4):
        everywhere = Wind(updraft=float(w))
        uniform = rates(x, u, parameters, variant, Winds(everywhere, everywhere))
        assert rates(x, u, parameters, variant, winds_named(("updraft",), (float(w),))) == uniform
        parts = winds_named(("updraft_outer", "updraft_center"), (float(w), float(w)))
        assert rates(x, u, parameters, variant, parts) == uniform
    # The instructions are those of an updraft alone: what is not there costs nothing.
    (x, u, p), w = symbols(), ca.SX.sym("w")
    sizes = [
        ca.Function("f", [x, u, p, w], [state_rates(x, u, p, variant, air)], {"cse": True}).n_instructions()
        for air in (winds_named(("updraft",), (w,)), Winds(Wind(w, 0.0, 0.0), Wind(w, 0.0, 0.0)))
    ]
    assert len(set(sizes)) == 1


def seen_from_the_ground(x: State, updraft: float, headwind: float) -> State:
    """The state over ground of an aircraft whose state through the air is x."""
    gamma = x.pitch - x.alpha
    north, up = x.speed * np.cos(gamma) - headwind, x.speed * np.sin(gamma) + updraft
    return x._replace(speed=float(np.hypot(north, up)), alpha=x.pitch - float(np.arctan2(up, north)))


def inertial(x: State, rate: State) -> np.ndarray:
    """Accelerations that no steady motion of the observer changes: north, up, pitch, dihedral."""
    gamma, gamma_rate = x.pitch - x.alpha, rate.pitch - rate.alpha
    along, across = np.array([np.cos(gamma), np.sin(gamma)]), np.array([-np.sin(gamma), np.cos(gamma)])
    return np.array([*(rate.speed * along + x.speed * gamma_rate * across), rate.pitch_rate, rate.dihedral_rate])


def galilean_error(parameters: Parameters, variant: Variant, updraft: float, headwind: float) -> np.ndarray:
    """How far accelerations in uniform steady wind are from those in still air, (4,), the largest of many states."""
    winds, worst = winds_named(("updraft", "headwind"), (updraft, headwind)), np.zeros(4)
    for x, u, _ in points(100, seed=5):
        moving = seen_from_the_ground(x, updraft, headwind)
        still = inertial(x, rates(x, u, parameters, variant))
        error = np.abs(inertial(moving, rates(moving, u, parameters, variant, winds)) - still)
        worst = np.maximum(worst, error)
    return worst


@pytest.mark.parametrize(("updraft", "headwind"), [(15.0, 0.0), (0.0, 15.0), (0.0, -15.0), (-9.0, 12.0)])
def test_newton_does_not_know_steady_wind_and_published_does(
    parameters: Parameters, updraft: float, headwind: float
) -> None:
    newton, published = (
        galilean_error(parameters, VARIANTS[name], updraft, headwind) for name in ("newton", "published")
    )
    assert newton.max() <= 1e-9
    assert published[:3].max() <= 1e-9  # only the hinge's equation has V over ground in it
    assert published[3] > 1e-2


def test_drag_over_ground_knows_steady_wind(parameters: Parameters) -> None:
    x, u, _ = points(1, seed=5)[0]
    moving, winds = seen_from_the_ground(x, 0.0, 15.0), winds_named(("headwind",), (15.0,))
    still = inertial(x, rates(x, u, parameters, Newton()))
    for ground_drag, low, high in ((False, 0.0, 1e-9), (True, 1e-2, 1e2)):
        found = rates(moving, u, parameters, Newton(), winds._replace(ground_drag=ground_drag))
        assert low <= np.abs(inertial(moving, found) - still).max() <= high


def test_names_add_up() -> None:
    winds = winds_named(NAMES, [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])
    assert winds == Winds(Wind(3.0, 24.0, 0.0), Wind(5.0, 40.0, 64.0))
    assert set(STATES).isdisjoint(NAMES)
