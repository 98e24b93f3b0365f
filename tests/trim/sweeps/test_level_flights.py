"""The batch against the robust solver, point by point, with and without machine code."""

import numpy as np
import pytest

from hfa_model import INPUTS, STATES, VARIANTS, Aircraft, default_parameters
from hfa_model.variants import variant_named
from hfa_support.native.machine_code import c_compiler
from trim import find_operating_point, level_conditions, level_flight, linearize, solve_level_flights
from trim.sweeps.level_flights import CONDITION


def _conditions(count: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    lowest = [0.0, 60.0, 20_000.0, np.radians(2.0), np.radians(-3.0)]
    highest = [np.radians(20), 75.0, 45_000.0, np.radians(4.0), np.radians(3.0)]
    return rng.uniform(lowest, highest, size=(count, len(CONDITION)))


@pytest.mark.parametrize("dynamics", VARIANTS)
@pytest.mark.parametrize("compile_code", [False, True])
def test_a_batch_is_the_robust_solver_point_by_point(dynamics, compile_code):
    parameters = default_parameters().values
    conditions = _conditions(25, seed=4)
    batch = solve_level_flights(variant_named(dynamics), parameters, conditions, compile_code=compile_code)
    aircraft = Aircraft(parameters, dynamics)
    compared = 0
    for index in np.flatnonzero(batch.trimmed):
        point = find_operating_point(
            aircraft, level_flight(**dict(zip(CONDITION, conditions[index].tolist(), strict=True)))
        )
        model = linearize(aircraft, point, full=True)
        assert batch.states[index] == pytest.approx(np.array(point.states), rel=1e-9, abs=1e-12)
        assert batch.inputs[index] == pytest.approx(np.array(point.inputs), rel=1e-9, abs=1e-12)
        assert batch.A[index] == pytest.approx(model.A, rel=1e-9, abs=1e-9)
        assert batch.B[index] == pytest.approx(model.B, rel=1e-9, abs=1e-9)
        compared += 1
    assert compared >= 15


def test_what_does_not_balance_or_leaves_the_limits_is_not_trimmed():
    parameters = default_parameters().values
    conditions = np.array(
        [
            [0.1, 68.0, 40_000.0, 0.05, 0.0],
            [0.1, 30.0, 40_000.0, 0.05, 0.0],  # needs more aileron than there is
            [0.1, np.nan, 40_000.0, 0.05, 0.0],
        ]
    )
    batch = solve_level_flights(variant_named("published"), parameters, conditions)
    assert batch.trimmed.tolist() == [True, False, False]
    assert abs(batch.inputs[1, INPUTS.index("aileron_outer")]) > np.radians(20)


def test_parameters_may_vary_from_point_to_point():
    parameters = default_parameters().values
    heavier = parameters._replace(panel_mass=1.1 * parameters.panel_mass)
    conditions = np.tile(_conditions(1, seed=1), (2, 1))
    both = solve_level_flights(variant_named("newton"), np.array([parameters, heavier]), conditions)
    alone = solve_level_flights(variant_named("newton"), heavier, conditions[1:])
    assert np.array_equal(both.A[1], alone.A[0])
    assert not np.allclose(both.A[0], both.A[1])
    assert both.states.shape == (2, len(STATES))


@pytest.mark.skipif(c_compiler() is None, reason="no C compiler on this machine")
def test_the_vector_unit_agrees_within_rounding(aircraft: Aircraft) -> None:
    random = np.random.default_rng(3)
    varied = ("dihedral", "speed", "altitude", "alpha")
    lowest, highest = [0.0, 60.0, 30_000.0, 0.03], [0.35, 75.0, 45_000.0, 0.06]
    conditions = level_conditions(varied, random.uniform(lowest, highest, (1000, 4)))
    parameters = np.array(aircraft.parameters) * random.uniform(0.99, 1.01, (1000, len(aircraft.parameters)))
    one = solve_level_flights(aircraft.variant, parameters, conditions)
    other = solve_level_flights(aircraft.variant, parameters, conditions, vector=True)
    np.testing.assert_array_equal(one.trimmed, other.trimmed)
    assert one.trimmed.sum() > 900
    for name in ("states", "inputs", "A", "B"):
        known, found = getattr(one, name), getattr(other, name)
        size = np.abs(known).max(axis=tuple(range(1, known.ndim)), keepdims=True)
        assert (np.abs(found - known) / size).max() < 1e-13, name
