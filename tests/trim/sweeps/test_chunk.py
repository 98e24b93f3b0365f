"""Each point of a chunk carries what became of it, and beyond the limits which variable is farthest."""

from __future__ import annotations

import numpy as np
import pytest

from hfa_model import INPUTS, STATES, Aircraft, Parameters
from trim.point.condition import LIMITS
from trim.sweeps.chunk import BEYOND_LIMITS, NO_TRIM, TRIMMED, run_chunk
from trim.sweeps.stored_sweep import run_points

VARIABLES = ("speed", "gamma", "alpha")
#: Speed ft/s, gamma and alpha rad -> the variable farthest beyond its limits, in widths of them.
FARTHEST = {
    (68.0, 0.35, 0.0489): "throttle",
    (68.0, -0.35, 0.0489): "throttle",
    (30.0, 0.0, 0.0489): "elevator_center",
    (68.0, 0.0, 0.36): "elevator_center",  # the throttle by more, but by less of its width
    (68.0, 0.0, 0.0489): "",
}


def test_a_chunk_names_the_variable_farthest_beyond_its_limits(aircraft: Aircraft) -> None:
    chunk = run_chunk(VARIABLES, np.array(list(FARTHEST)), aircraft.parameters, aircraft.variant.name)
    names = STATES + INPUTS
    for i, expected in enumerate(FARTHEST.values()):
        assert chunk.status[i] == (BEYOND_LIMITS if expected else TRIMMED)
        assert chunk.limiting[i] == (names.index(expected) if expected else -1)
        values = dict(zip(names, [*chunk.states[i], *chunk.inputs[i]], strict=True))
        finite = {name: limits for name, limits in LIMITS.items() if np.isfinite(limits).all()}
        excess = {n: max(low - values[n], values[n] - high) / (high - low) for n, (low, high) in finite.items()}
        assert max(excess.values()) == excess[expected] > 0 if expected else max(excess.values()) <= 0


def test_each_point_of_a_chunk_carries_its_status(parameters: Parameters) -> None:
    values = np.array([[0.1, 68.0], [0.1, 30.0], [0.1, -5.0]])
    chunk = run_chunk(("dihedral", "speed"), values, parameters, "published")
    assert chunk.status.tolist() == [TRIMMED, BEYOND_LIMITS, NO_TRIM]
    assert np.isfinite(chunk.A[0]).all()
    assert np.isnan(chunk.A[1:]).all()
    assert chunk.limiting[0] == -1
    assert chunk.limiting[1] >= 0
    # The store has the eigenvalues of A beside it, fastest first.
    rows = run_points(("dihedral", "speed"), values, parameters, "published", False)
    assert np.all(np.diff(np.abs(rows["eigenvalues"][0])) <= 1e-9)
    assert np.prod(rows["eigenvalues"][0]) == pytest.approx(np.linalg.det(chunk.A[0]), abs=1e-9)
    assert np.isnan(rows["eigenvalues"][1:]).all()
