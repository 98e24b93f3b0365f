"""Trims: balance of all equations, imposed values, and causes of failed trims."""

import math
import re

import numpy as np
import pytest
from project import ROOT
from random_points import INPUT_SCALES, RATE_SCALES

import hfa
import hfa_model
from hfa import Model, NoSolutionError, Signal, TrimCondition, trim
from hfa.paper import level_flight
from hfa_model import STATES
from trim import TrimError, release

BASE = level_flight(float(np.radians(15.0)))


def assert_meets(aircraft, condition, point):
    """Assert that a point satisfies a condition: balance, imposed values, limits and residuals."""
    assert point.status == "trimmed"
    rates = dict(zip(STATES, aircraft.at(point.states, point.inputs).f.tolist(), strict=True))
    for name, imposed in condition.rates.items():
        assert abs(rates[name] - imposed) / getattr(RATE_SCALES, name) <= 1e-10, name
        assert point.residuals[name] == pytest.approx(rates[name] - imposed, abs=1e-12)
    assert set(point.residuals) == set(condition.rates)
    values = point.values
    for name, imposed in condition.imposed.items():
        # gamma is stored as pitch - alpha.
        assert values[name] == pytest.approx(imposed, rel=1e-15, abs=1e-16), name
    for name in condition.free:
        lowest, highest = condition.limits_of(name)
        assert lowest - 1e-12 <= values[name] <= highest + 1e-12, name


def effort(point):
    """Return the control effort Σ (u / scale)² that trims of least effort minimize."""
    return float(((np.array(point.inputs) / np.array(INPUT_SCALES)) ** 2).sum())


@pytest.mark.parametrize(("degrees", "climb"), [(0.0, 0.0), (15.0, 1.0)])
def test_the_papers_trims_are_found(published_aircraft, degrees, climb):
    """The paper's trims, at 68 ft/s, 40,000 ft and an angle of attack of 2.8 deg, are found in level flight
    and in a climb.
    """
    condition = level_flight(float(np.radians(degrees)), gamma=float(np.radians(climb)))
    point = trim(published_aircraft, condition)
    assert_meets(published_aircraft, condition, point)
    assert [point[n] for n in ("speed", "altitude", "aileron_center")] == [68.0, 40_000.0, 0.0]
    assert np.degrees(point.states.alpha) == pytest.approx(2.8, rel=1e-15)
    assert np.degrees(point.states.dihedral) == pytest.approx(degrees, rel=1e-15)
    rates = published_aircraft.at(point.states, point.inputs).f
    climbing = rates[STATES.index("altitude")]
    assert climbing == pytest.approx(68.0 * np.sin(np.radians(climb)), rel=1e-12, abs=1e-12)


# More unknowns than equations.


def test_least_effort_is_a_minimum(published_aircraft):
    """With more unknowns than equations, the trim with the least effort is found.

    If an unknown is held slightly aside, the effort increases by second order.
    """
    condition = release(BASE, free=("aileron_center", "alpha"))
    point = trim(published_aircraft, condition)
    assert_meets(published_aircraft, condition, point)
    for name in ("aileron_center", "alpha"):
        aside = [
            release(condition, hold={name: point.values[name] + step}) for step in (-1e-3, 1e-3)
        ]
        efforts = [effort(trim(published_aircraft, nearby)) for nearby in aside]
        assert min(efforts) > effort(point), name
        # At a minimum, both sides have the same effort to second order.
        assert abs(efforts[1] - efforts[0]) < 0.05 * (
            efforts[0] + efforts[1] - 2 * effort(point)
        ), name


@pytest.mark.parametrize(
    ("limited", "limits"), [("elevator_outer", (-0.02, 0.5)), ("aileron_outer", (0.01, 0.02))]
)
def test_least_effort_stays_within_limits(published_aircraft, limited, limits):
    """If the minimum of effort without limits is outside a limit, the trim is at this limit."""
    unlimited = trim(published_aircraft, release(BASE, free=("aileron_center",))).values[limited]
    assert not limits[0] <= unlimited <= limits[1]
    condition = release(
        level_flight(float(np.radians(15.0)), limits={limited: limits}), free=("aileron_center",)
    )
    point = trim(published_aircraft, condition)
    assert_meets(published_aircraft, condition, point)
    assert point.values[limited] == pytest.approx(np.clip(unlimited, *limits), abs=1e-9)


# No solution.


@pytest.mark.parametrize("extra", [(), ("aileron_center",)])
def test_a_binding_limit_is_named(published_aircraft, extra):
    """If a limit on the throttle prevents the trim, the message names the limit and the equation that fails,
    that of the speed. The attempt that the error has is the best point within the limit.

    extra: variables that are set free in addition, which do not help
    """
    limited = level_flight(float(np.radians(15.0)), limits={"throttle": (0.0, 30.0)})
    with pytest.raises(TrimError) as caught:
        trim(published_aircraft, release(limited, free=extra))
    message = str(caught.value)
    attempt = caught.value.attempt
    assert "\n" not in message
    assert "throttle at maximum 30" in message
    # Level flight needs 40 lbf of thrust: 10 lbf less decelerate 28 slug by 0.36 ft/s^2.
    assert re.match(r"no trim: these rates do not balance: speed by -0\.3\d+ ft/s\^2, ", message)
    assert attempt.equation_unit("speed") == "ft/s^2"
    assert attempt.status == "failed"
    assert attempt.inputs.throttle == pytest.approx(30.0, rel=1e-15)
    rates = published_aircraft.at(attempt.states, attempt.inputs).f
    accelerating = rates[STATES.index("speed")]
    assert accelerating == pytest.approx(attempt.residuals["speed"], rel=1e-12)


def test_the_value_beyond_a_limit_that_a_trim_requires_is_named():
    """The lift of the UAV, 132 N, at 14 m/s requires an angle of attack of 25.6 deg, above its limit of 0.3 rad."""
    model = hfa.load_model(f"{ROOT}/examples/uav.toml")
    with pytest.raises(TrimError, match=r"alpha at maximum 17\.1887 deg, 25\.6\d* deg required"):
        trim(model, speed=14.0)


def test_too_few_unknowns_name_the_equations(published_aircraft):
    """If fewer unknowns are free than there are equations, the message counts both, and names the two
    largest residuals and the number of the others.
    """
    held = {"aileron_outer": 0.0, "elevator_outer": 0.0}
    with pytest.raises(NoSolutionError) as caught:
        trim(published_aircraft, release(BASE, hold=held))
    error = caught.value
    assert isinstance(error, TrimError)
    assert "4 equations for 2 unknowns; free more variables" in str(error)
    failing = {name: value for name, value in error.attempt.residuals.items() if abs(value) > 1e-9}
    named = [name for name, value in failing.items() if f"{name} by {value:.3g}" in str(error)]
    assert len(named) == 2
    assert f" and {len(failing) - 2} more (" in str(error)


# Limits of the pitch angle, alpha + gamma, in single trims and in sweeps.


def test_the_pitch_limit_is_checked_with_free_angles(published_aircraft):
    """If alpha and gamma are free and within their limits, the limit of pitch, alpha + gamma, is
    checked.

    A trim at gamma = 62 deg and alpha = 2.8 deg exists with wider limits of the pitch. A search from
    there, with its controls held, names the pitch 64.8 deg.
    """
    # A light aircraft with 100 times the thrust can climb at any angle.
    p = hfa_model.parameters_of(published_aircraft)
    strong_aircraft = published_aircraft.with_parameters(
        thrust_per_throttle=100 * p.thrust_per_throttle, panel_mass=0.9 * p.panel_mass
    )
    steep = level_flight(0.0, gamma=float(np.radians(62.0)), limits={"pitch": (-2.0, 2.0)})
    beyond = trim(strong_aircraft, steep)
    held = {name: getattr(beyond.inputs, name) for name in ("throttle", "aileron_outer")}
    both = release(level_flight(0.0), free=("alpha", "gamma"), hold=held)
    with pytest.raises(
        TrimError,
        match=r"pitch would have to be 64\.8 deg, but must lie between -60 deg and 60 deg",
    ):
        trim(strong_aircraft, both, start=beyond)


def test_an_equilibrium_with_all_variables_held_is_a_trim():
    """A condition that holds each variable is a trim if all rates are 0: v' = force - 2 x at x = 1, v = 0 and
    force = 2.
    """
    model = Model(
        "cart",
        {"x": Signal("m"), "v": Signal("m/s")},
        {"force": Signal("N")},
        lambda x, u, p, w: ({"x": x.v, "v": u.force - 2.0 * x.x}, {}),
    )
    point = trim(model, TrimCondition(model, {"x": 1.0, "v": 0.0, "force": 2.0}))
    assert point.ok
    assert (point["x"], point["force"], point.residual) == (1.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("aircraft", "parameter", "control", "value"),
    [
        ("examples/glider.toml", "cg", "elevator", math.radians(-15.0)),
        ("examples/f16.py:F16", "xcg", "elevator", -5.0),
        ("examples/uav.toml", "mass", "thrust", 25.0),
        ("", "panel_mass", "throttle", 45.0),
    ],
)
def test_a_free_parameter_is_found_from_a_held_control(aircraft, parameter, control, value):
    """A trim with a held control and a free parameter finds the parameter. A trim of the aircraft with this
    parameter finds the value of the control, and the same A. A sweep refuses to free a parameter.
    """
    model = hfa.load_model(f"{ROOT}/{aircraft}") if aircraft else hfa.aircraft()
    found = hfa.trim(model, free=parameter, hold={control: value})
    assert found[control] == value
    number = found.model.parameters[parameter].start
    assert number != model.parameters[parameter].start
    again = hfa.trim(model.with_parameters(**{parameter: number}))
    assert again[control] == pytest.approx(value, rel=1e-7)
    assert f"{parameter} " in found.report().title
    assert pytest.approx(again.linearize().A, rel=1e-6, abs=1e-9) == found.linearize().A
    with pytest.raises(hfa.BadInputError, match=f"does not free the parameter {parameter}"):
        hfa.sweep(model, {control: [value]}, condition=found.trim_problem.asked)


def test_values_with_units_are_converted():
    """70 kt are 36.0111 m/s, and rates with units are imposed in those of the model. The changes of a
    condition are those numbers.
    """
    model = hfa.load_model(f"{ROOT}/examples/uav.toml")
    condition = hfa.trim(model, speed="70 kt", beta="2 deg", speed_dot="1 kt/s").trim_problem.asked
    held = {"speed": 70.0 * 1852.0 / 3600.0, "beta": math.radians(2.0)}
    assert condition.changes["imposed"] == pytest.approx(held)
    assert condition.changes["rates"]["speed"] == pytest.approx(1852.0 / 3600.0)
    assert condition.values_at("beta", np.zeros(2)) == pytest.approx(np.full(2, held["beta"]))
    assert "rates" not in release(condition, hold={"speed_dot": 0.0}).changes
