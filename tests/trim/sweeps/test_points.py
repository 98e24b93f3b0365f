"""Many points at once against the robust solver, point by point; what it leaves open; the status of each point."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import INPUTS, STATES, VARIANTS, Aircraft, Parameters
from hfa_model.aircraft import HFA
from hfa_support import BadInputError
from trim import find_operating_point, level_flight, linearize, release, sweep, trim_points
from trim.point.condition import LEVEL_FLIGHT
from trim.sweeps import points as many
from trim.sweeps.points import BEYOND_LIMITS, NO_TRIM, TRIMMED
from trim.sweeps.sweep import run_points

LEVEL = ("dihedral", "speed", "altitude", "alpha", "gamma")
LOWEST, HIGHEST = [0.0, 60.0, 20_000.0, 0.035, -0.05], [0.35, 75.0, 45_000.0, 0.07, 0.05]
GLIDE = release(LEVEL_FLIGHT, free=("alpha", "gamma"), hold={"throttle": 0.0, "elevator_outer": 0.0})
ANGLES = np.radians([[5.0], [15.0]])
WORDS = "the equations overflow or divide by zero at this condition with these parameters"
#: The parameter and a value at which the first guess, the rates or their Jacobian overflow.
EXTREMES = [("lift_slope", 1e200), ("inertia_pitch", 1e-300)]


@pytest.mark.parametrize("dynamics", VARIANTS)
@pytest.mark.parametrize("compile_code", [False, True])
@pytest.mark.parametrize(
    ("variables", "condition"), [(LEVEL, LEVEL_FLIGHT), (LEVEL[:3], GLIDE)], ids=["level", "glide"]
)
def test_many_points_are_those_of_the_robust_solver(dynamics, compile_code, variables, condition):
    aircraft, k = Aircraft(dynamics=dynamics), len(variables)
    values = np.random.default_rng(4).uniform(LOWEST[:k], HIGHEST[:k], size=(25, k))
    found = trim_points(aircraft, variables, values, condition, compile_code=compile_code)
    trimmed = np.flatnonzero(found.status == TRIMMED)
    assert trimmed.size >= 15
    for i in trimmed:
        single = many.condition_at(condition, variables, values[i])
        model = linearize(aircraft, find_operating_point(aircraft, single), full=True)
        np.testing.assert_allclose(found.states[i], model.point.states, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(found.inputs[i], model.point.inputs, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(found.A[i], model.A, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(found.B[i], model.B, rtol=1e-9, atol=1e-8)


def test_no_row_depends_on_its_neighbours(aircraft: Aircraft) -> None:
    """Bit for bit: alone, with few and with many others; parameters may vary from point to point."""
    random = np.random.default_rng(1)
    variables = ("dihedral", "speed", "panel_mass")
    values = random.uniform([0.0, 55.0, 9.5], [0.35, 75.0, 11.5], (600, 3))
    whole = trim_points(aircraft, variables, values)
    for rows in (slice(7, 8), slice(30, 60), slice(200, 480)):
        part = trim_points(aircraft, variables, values[rows])
        np.testing.assert_array_equal(part.A, whole.A[rows])
        np.testing.assert_array_equal(part.inputs, whole.inputs[rows])
    heavy = Aircraft(aircraft.parameters._replace(panel_mass=values[7, 2]), aircraft.variant)
    np.testing.assert_array_equal(trim_points(heavy, variables[:2], values[7:8, :2]).A, whole.A[7:8])


def test_each_point_carries_its_status(aircraft: Aircraft) -> None:
    """Speed ft/s, gamma and alpha rad: climb, dive, too slow, too steep an alpha, level, no air speed."""
    statuses = {
        (68.0, 0.35, 0.0489): BEYOND_LIMITS,
        (68.0, -0.35, 0.0489): BEYOND_LIMITS,
        (30.0, 0.0, 0.0489): BEYOND_LIMITS,
        (68.0, 0.0, 0.36): BEYOND_LIMITS,
        (68.0, 0.0, 0.0489): TRIMMED,
        (-5.0, 0.0, 0.0489): NO_TRIM,
    }
    values = np.array(list(statuses))
    found = trim_points(aircraft, ("speed", "gamma", "alpha"), values)
    assert found.status.tolist() == list(statuses.values())
    assert np.isfinite(found.A).all(axis=(1, 2)).tolist() == [status == TRIMMED for status in statuses.values()]
    limits = np.array([HFA.limits[name] for name in (*STATES, *INPUTS)])
    at = np.hstack([found.states, found.inputs])[:5]
    within = ((at >= limits[:, 0]) & (at <= limits[:, 1])).all(axis=1)
    assert within.tolist() == [status == TRIMMED for status in statuses.values()][:5]
    # The store has the eigenvalues of A beside it, fastest first.
    rows = run_points(aircraft, ("speed", "gamma", "alpha"), values, LEVEL_FLIGHT, None, False)
    assert np.all(np.diff(np.abs(rows["eigenvalues"][4])) <= 1e-9)
    assert np.prod(rows["eigenvalues"][4]) == pytest.approx(np.linalg.det(found.A[4]), abs=1e-9)
    assert np.isnan(rows["eigenvalues"][:4]).all()


@pytest.fixture
def idle(monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft) -> Aircraft:
    """An aircraft for which Newton's method on many points balances nothing."""
    monkeypatch.setattr(many, "_key", lambda *_: None)
    return published_aircraft


def test_what_newton_leaves_open_the_robust_solver_settles(idle: Aircraft) -> None:
    found, result = trim_points(idle, ("dihedral",), ANGLES), sweep(idle, {"dihedral": ANGLES[:, 0]})
    for i, angle in enumerate(ANGLES[:, 0]):
        point = find_operating_point(idle, level_flight(float(angle)))
        for points, model in ((found, linearize(idle, point, full=True)), (result, linearize(idle, point))):
            assert (points.states[i].tolist(), points.inputs[i].tolist()) == (list(point.states), list(point.inputs))
            np.testing.assert_array_equal(points.A[i], model.A)
            np.testing.assert_array_equal(points.B[i], model.B)
    masses = idle.parameters.panel_mass * np.array([[1.0], [1.1]])
    heavier = Aircraft(idle.parameters._replace(panel_mass=float(masses[1, 0])))
    inputs = trim_points(idle, ("panel_mass",), masses).inputs
    assert inputs[1].tolist() == list(find_operating_point(heavier, level_flight(0.0)).inputs) != inputs[0].tolist()


@pytest.mark.parametrize(("name", "value"), EXTREMES)
@pytest.mark.parametrize("free", [(), ("aileron_center",)])
def test_an_extreme_parameter_is_refused(
    parameters: Parameters, name: str, value: float, free: tuple[str, ...]
) -> None:
    with pytest.raises(BadInputError, match=f"{WORDS}; take values"):
        find_operating_point(Aircraft(parameters._replace(**{name: value})), release(level_flight(0.0), free=free))
    # In a sweep it is a row.
    reasons = sweep(Aircraft(parameters._replace(**{name: value})), {"dihedral": [0.0, 0.2]}).reasons
    assert WORDS in reasons[0]
    found = trim_points(Aircraft(parameters), (name,), np.array([[value], [getattr(parameters, name)]]))
    assert found.status.tolist() == [NO_TRIM, TRIMMED]
    assert np.isfinite(found.A[1]).all()


def test_wrong_tables_are_refused(aircraft: Aircraft) -> None:
    with pytest.raises(BadInputError, match=r"values are \(2,\); they must be \(N, 1\)"):
        trim_points(aircraft, ("speed",), [1.0, 2.0])
    with pytest.raises(BadInputError, match="values has masked entries"):
        trim_points(aircraft, ("speed",), np.ma.masked_array([[60.0], [68.0]], [[True], [False]]))
