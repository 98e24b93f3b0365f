"""What the batch's Newton leaves open, the robust solver settles: in sweeps in memory and in chunks of a store."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import STATES, Aircraft
from hfa_model.variants import variant_named
from trim import TrimError, find_operating_point, level_conditions, level_flight, linearize, solve_level_flights, sweep
from trim.sweeps import level_flights
from trim.sweeps.chunk import NO_TRIM, TRIMMED, run_chunk

ANGLES = np.radians([[5.0], [15.0]])


@pytest.fixture
def idle_batch(monkeypatch: pytest.MonkeyPatch, published_aircraft: Aircraft) -> Aircraft:
    """An aircraft whose batch takes no Newton step, so that it balances nothing."""
    monkeypatch.setattr(level_flights, "_NEWTON_STEPS", 0)
    monkeypatch.setattr(level_flights, "_MORE_NEWTON_STEPS", 0)
    conditions = level_conditions(("dihedral",), ANGLES)
    batch = solve_level_flights(variant_named("published"), published_aircraft.parameters, conditions)
    assert not batch.balanced.any()
    return published_aircraft


def test_a_sweep_has_the_robust_solvers_points(idle_batch: Aircraft) -> None:
    result = sweep(idle_batch, {"dihedral": ANGLES[:, 0]})
    assert result.reasons == ("", "")
    for i, angle in enumerate(ANGLES[:, 0]):
        point = find_operating_point(idle_batch, level_flight(float(angle)))
        model = linearize(idle_batch, point)
        assert (result.states[i].tolist(), result.inputs[i].tolist()) == (list(point.states), list(point.inputs))
        np.testing.assert_array_equal(result.A[i], model.A)
        np.testing.assert_array_equal(result.B[i], model.B)
        found = np.sort_complex(np.linalg.eigvals(model.A))
        np.testing.assert_allclose(np.sort_complex(result.eigenvalues[i]), found, rtol=1e-9, atol=1e-12)


def test_a_chunk_has_the_robust_solvers_points(idle_batch: Aircraft) -> None:
    chunk = run_chunk(("dihedral",), ANGLES, idle_batch.parameters, "published")
    assert chunk.status.tolist() == [TRIMMED, TRIMMED]
    for i, angle in enumerate(ANGLES[:, 0]):
        point = find_operating_point(idle_batch, level_flight(float(angle)))
        model = linearize(idle_batch, point, full=True)
        assert (chunk.states[i].tolist(), chunk.inputs[i].tolist()) == (list(point.states), list(point.inputs))
        np.testing.assert_array_equal(chunk.A[i], model.A)
        np.testing.assert_array_equal(chunk.B[i], model.B)


def test_a_chunk_asks_the_robust_solver_about_the_points_own_parameters(idle_batch: Aircraft) -> None:
    parameters = idle_batch.parameters
    masses = parameters.panel_mass * np.array([[1.0], [1.1]])
    chunk = run_chunk(("panel_mass",), masses, parameters, "published")
    heavier = Aircraft(parameters._replace(panel_mass=float(masses[1, 0])))
    assert chunk.inputs[1].tolist() == list(find_operating_point(heavier, level_flight(0.0)).inputs)
    assert chunk.inputs[0].tolist() != chunk.inputs[1].tolist()


def test_what_the_robust_solver_cannot_trim_either_keeps_its_reason(idle_batch: Aircraft) -> None:
    with pytest.raises(TrimError) as caught:
        find_operating_point(idle_batch, level_flight(0.0, speed=30.0))
    assert sweep(idle_batch, {"speed": [68.0, 30.0]}).reasons == ("", str(caught.value))
    chunk = run_chunk(("speed",), np.array([[68.0], [30.0], [-5.0]]), idle_batch.parameters, "published")
    assert chunk.status.tolist() == [TRIMMED, NO_TRIM, NO_TRIM]
    assert chunk.limiting.tolist() == [-1, -1, -1]
    assert chunk.failures == {1: str(caught.value), 2: "speed is -5 ft/s; it must lie between 1 ft/s and 500 ft/s"}
    assert np.isnan(chunk.states[1:, STATES.index("speed")]).all()
