"""Names of states, inputs and modes as keys of trims, linear models and sweeps."""

import copy
import json
import pickle
from functools import cache

import numpy as np
import pytest

import hfa
from hfa import NoSolutionError, linearize, sweep, trim

MODEL = hfa.aircraft()


@cache
def _linear():
    return linearize(MODEL, trim(MODEL))


def test_names_index_matrices():
    """Rows and columns of A and B can be indexed by name, also in copies."""
    linear = _linear()
    row, column = linear.states.index("pitch_rate"), linear.states.index("alpha")
    entry = np.array(linear.A)[row, column]
    assert linear.A["pitch_rate", "alpha"] == entry
    assert np.array_equal(linear.B["pitch_rate", :], linear.B[row])
    assert np.array_equal(linear.B["throttle"], linear.B[:, 0])
    # A sum is a plain number, which JSON can store.
    assert json.loads(json.dumps(linear.A.sum())) == float(np.sum(np.array(linear.A)))
    for again in (pickle.loads(pickle.dumps(linear.A)), copy.deepcopy(linear).A):
        assert again["pitch_rate", "alpha"] == entry


def test_a_sweep_is_a_sequence_of_linear_models():
    """`swept[i]` and iteration give the linear models of the points; `at` trims between the points.

    An index beyond the points, a point without a trim (5 ft/s), and `at` without a value of each
    variable are refused.
    """
    swept = sweep(MODEL, {"dihedral": [0.1, 0.2], "speed": [66.0, 68.0]})
    for each in (swept, pickle.loads(pickle.dumps(swept))):
        assert each.states["alpha"].tolist() == [linear.point["alpha"] for linear in each]
    for index, linear in enumerate(swept):
        assert pytest.approx(swept.A[index], rel=1e-9, abs=1e-9) == linear.A
        mode, tracked = linear.modes["phugoid"], swept.modes["phugoid"]
        assert tracked.damping[index] == pytest.approx(mode.damping)
    assert (len(swept), swept[-1].point["dihedral"]) == (4, 0.2)
    alone = linearize(MODEL, trim(MODEL, dihedral=0.15, speed=67.0))
    found = swept.at(speed=67.0, dihedral=0.15)
    assert pytest.approx(alone.A, rel=1e-9, abs=1e-9) == found.A
    with pytest.raises(hfa.BadInputError, match="give one value for each of dihedral, speed"):
        swept.at(speed=67.0)
    with pytest.raises(IndexError, match="choose from -4 to 3"):
        swept[4]
    with pytest.raises(NoSolutionError, match="point 1 has no trim"):
        sweep(MODEL, {"dihedral": [0.2], "speed": [68.0, 5.0]})[1]
