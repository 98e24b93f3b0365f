"""Command of a deployment file and its slopes, compared with Stable-Baselines3 in float64."""

import json

import numpy as np
import pytest
from policy_cases import FOLDER, aircraft, stored_deployment

from hfa_flight import Deployed

SLOPES = json.loads((FOLDER / "slopes.json").read_text())


@pytest.mark.parametrize("name", SLOPES)
def test_actions_and_slopes_equal_stored_references(name):
    """Actions and slopes of the policies equal stored values of the modules of Stable-Baselines3 in
    float64: policy.double(), the normalization of VecNormalize, and torch.autograd.functional.jacobian.
    """
    import casadi as ca

    act = Deployed(stored_deployment(name), aircraft(name)).act
    o = ca.MX.sym("o", act.numel_in(0))
    slope = ca.Function("slope", [o], [ca.jacobian(act(o), o)])
    assert len(SLOPES[name]) == 5
    for entry in SLOPES[name]:
        observation = np.array(entry["observation"])
        action = np.array(act(observation)).ravel()
        np.testing.assert_allclose(action, entry["action"], rtol=0, atol=1e-12)
        expected = np.array(entry["slope"])
        found = np.array(slope(observation))
        np.testing.assert_allclose(found, expected, atol=1e-10 * max(1.0, np.abs(expected).max()))
