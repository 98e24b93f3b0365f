"""Contradictions between a gain's file and its deployment, and effects of actions."""

import casadi as ca
import numpy as np
import pytest
from policy_cases import (
    ROOT,
    aircraft,
    gtm_deployment,
    model_of,
    stored_deployment,
)

import hfa
from hfa import Deployment, assess


@pytest.mark.parametrize(
    ("entries", "found"),
    [
        ({}, 0),
        (
            {
                "states": ["speed", "alpha", "pitch_rate", "pitch"],
                "inputs": ["elevator", "throttle"],
            },
            0,
        ),
        ({"states": ["alpha", "speed", "pitch_rate", "pitch"]}, 1),
        ({"inputs": ["throttle", "elevator"]}, 1),
        ({"dt": 0.05}, 1),
        ({"dt": 0.02}, 0),
        ({"state_units": ["m/s", "deg", "rad/s", "rad"]}, 1),
        ({"state_units": ["m/s", "rad", "rad/s", "rad"]}, 0),
    ],
)
def test_a_gain_is_of_its_states_inputs_units_and_sample_time(tmp_path, entries, found):
    np.savez(tmp_path / "K.npz", K=0.01 * np.ones((2, 4)), **entries)
    deployment = gtm_deployment({"file": str(tmp_path / "K.npz")})
    told = hfa.assess(aircraft("ppo_gtm"), deployment, [45.0], samples=0).notes
    assert len(told) == found
    assert all(note.startswith("K is a gain") for note in told)


def exact_deployment(model, point, times=1.0):
    """Return the optimal gain for 1/nominal² as a deployment.

    times: factor on the actions
    """
    linear = hfa.linearize(model, point)
    Q = {name: model.states[name].nominal ** -2.0 for name in model.linear}
    R = {name: signal.nominal**-2.0 for name, signal in model.inputs.items()}
    K = hfa.solve(hfa.game(linear, Q, R)).K
    o = ca.SX.sym("o", K.shape[1])
    action = {name: {"map": f"trim + {times} * a"} for name in model.inputs}
    return Deployment(
        policy={"file": ca.Function("gain", [o], [-ca.DM(K) @ o])},
        observation={name: {} for name in model.linear},
        action=action,
        timing={"dt": 0.01},
    )


@pytest.mark.parametrize("name", ["gtm.py:GTM", pytest.param("uav.toml", marks=pytest.mark.slow)])
def test_the_exact_gain_has_its_own_effects(name):
    """For the exact gain, each action has the effect of the exact gain.

    The effects are positive, and nothing is noted.
    """
    model = model_of(f"{ROOT}/examples/{name}")
    point = hfa.trim(model, at=45.0) if name == "gtm.py:GTM" else hfa.trim(model)
    result = assess(model, exact_deployment(model, point), [point], samples=1, best=0)
    assert result.notes == []
    actions = result.points[0].actions
    assert [each.action for each in actions] == list(model.inputs)
    for each in actions:
        assert each.exact_effect > 0.0
        assert each.effect == pytest.approx(each.exact_effect, rel=1e-6)


def test_a_reversed_rudder_is_a_row_with_the_opposite_sign():
    """A reversed rudder has the opposite effect of the exact gain's. The other actions have theirs."""
    model = model_of(f"{ROOT}/examples/navion.py:NAVION")
    point = hfa.trim(model, at=176.0)
    right = exact_deployment(model, point)
    wrong = right.changed(action={**right.action, "rudder": {"map": "trim - a"}})
    result = assess(model, wrong, [point], samples=1, best=0)
    for each in result.points[0].actions:
        sign = -1.0 if each.action == "rudder" else 1.0
        assert each.effect == pytest.approx(sign * each.exact_effect, rel=1e-6)
    (row,) = [line for line in result.report().text().splitlines() if line.startswith("rudder ")]
    of_policy, of_exact = row.split()[1:]
    assert of_policy.startswith("-")
    assert of_policy[1:] == of_exact[1:]


def test_the_effects_shift_the_sum_of_the_eigenvalues():
    """The sum of the effects equals the difference of the sums of eigenvalues without and with K."""
    (point,) = assess(aircraft("ppo_gtm"), stored_deployment("ppo_gtm"), [45.0], samples=0).points
    loop = point.equilibrium
    moved = np.linalg.eigvals(loop.A).sum() - np.linalg.eigvals(loop.A - loop.B @ loop.K).sum()
    assert sum(each.effect for each in point.actions) == pytest.approx(moved.real, rel=1e-9)
