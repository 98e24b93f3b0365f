"""Files of gains in deployments, and effects of the actions of a deployed gain."""

import casadi as ca
import numpy as np
import pytest
from nominal import nominal_game
from policy_cases import GTM, gtm_deployment, model_of

import hfa
from hfa import BadInputError, assess


def assessed(folder, entries):
    """Return the assessment of a gain of the GTM, in a file with further entries."""
    np.savez(folder / "K.npz", K=0.01 * np.ones((2, 4)), **entries)
    deployment = gtm_deployment({"file": str(folder / "K.npz")})
    return assess(model_of(GTM), deployment, [45.0], samples=0)


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ({"states": ["alpha", "speed", "pitch_rate", "pitch"]}, "of the states alpha, speed"),
        ({"inputs": ["throttle", "elevator"]}, "of the inputs throttle, elevator"),
        ({"dt": 0.05}, "for dt = 0.05 s"),
        ({"state_units": ["m/s", "deg", "rad/s", "rad"]}, "give scale = 0.0174533"),
        ({"input_units": ["deg", "1"]}, 'give map = "trim'),
    ],
)
def test_a_deployment_that_contradicts_the_file_of_its_gain_is_refused(tmp_path, entries, said):
    """The file may state other states, inputs, units or another sample time than the deployment. The
    message has the remedy.
    """
    with pytest.raises(BadInputError) as caught:
        assessed(tmp_path, entries)
    assert said in str(caught.value)


@pytest.mark.parametrize(
    "entries",
    [
        {"inputs": ["elevator", "throttle"], "dt": 0.02},
        {"state_units": ["m/s", "rad", "rad/s", "rad"]},
        {"input_units": ["rad", "1"]},
    ],
)
def test_a_deployment_that_agrees_with_the_file_of_its_gain_is_assessed(tmp_path, entries):
    assert assessed(tmp_path, entries).points


def test_effects_are_those_of_the_exact_gain_and_reversed_with_an_action():
    """The effect of an action is its diagonal entry of K B, 1/s: its share in trace(B K), by which a gain
    shifts the sum of the poles to the left. The actions of the exact gain of the weights 1/nominal²
    have the exact effects, which sum up to this shift.

    With this gain and a reversed elevator, the elevator has the opposite effect, and the throttle the
    exact one.
    """
    model = model_of(GTM)
    point = hfa.trim(model, at=45.0)
    linear = hfa.linearize(model, point)
    K = hfa.solve(nominal_game(linear)).K
    o = ca.SX.sym("o", 4)
    gain = {"file": ca.Function("gain", [o], [-ca.DM(K) @ o])}
    sizes = {name: model.signals[name].nominal for name in (*linear.states, *linear.inputs)}
    weights = {name: size**-2.0 for name, size in sizes.items()}
    cost = {
        "Q": {name: weights[name] for name in linear.states},
        "R": {name: weights[name] for name in linear.inputs},
    }
    for sign in (1.0, -1.0):
        action = {"elevator": {"map": f"trim + {sign} * a"}, "throttle": {}}
        policy = gtm_deployment(gain, action=action, cost=cost)
        told = assess(model, policy, [point], samples=0)
        effects = {effect.action: effect for effect in told.points[0].actions}
        exact = {name: action.exact_effect for name, action in effects.items()}
        shift = np.linalg.eigvals(linear.A).sum() - np.linalg.eigvals(linear.A - linear.B @ K).sum()
        assert sum(exact.values()) == pytest.approx(shift.real, rel=1e-9)
        assert min(exact.values()) > 0.0
        assert effects["elevator"].effect == pytest.approx(sign * exact["elevator"], rel=1e-6)
        assert effects["throttle"].effect == pytest.approx(exact["throttle"], rel=1e-6)
