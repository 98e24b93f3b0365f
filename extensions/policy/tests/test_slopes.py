"""Command of a deployment file and its slopes, compared with Stable-Baselines3 in float64."""

import json
import zipfile

import numpy as np
import pytest
from policy_cases import FOLDER, aircraft, stored_deployment
from tolerances import SAME_FORMULA

from controller.critic.network.tensors import tensors_in
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.errors import BadInputError

SLOPES = json.loads((FOLDER / "slopes.json").read_text())


@pytest.mark.parametrize("name", SLOPES)
def test_actions_and_slopes_equal_stored_references(name):
    """Actions and slopes of the policies equal stored values of the PyTorch modules in float64."""
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


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOPES)
def test_stored_slopes_equal_stable_baselines3(name):
    """The stored actions and slopes equal those that Stable-Baselines3 computes again."""
    pytest.importorskip("stable_baselines3")
    from train_policies import slopes

    for stored, again in zip(SLOPES[name], slopes(name), strict=True):
        for key, values in stored.items():
            np.testing.assert_allclose(values, again[key], rtol=SAME_FORMULA, atol=1e-12)


def test_an_onnx_deployment_equals_its_zip(tmp_path):
    """A deployment file with an ONNX file has the actions of Stable-Baselines3."""
    onnx = pytest.importorskip("onnx")
    zipped = stored_deployment("ppo_gtm")
    with zipfile.ZipFile(FOLDER / "ppo_gtm.zip") as archive:
        tensors = tensors_in(archive.read("policy.pth"), ".pth")
    names = ("mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2", "action_net")
    make = onnx.helper.make_node
    nodes, weights, before = [], [], "o"
    for number, name in enumerate(names):
        parts = [f"{name}.weight", f"{name}.bias"]
        weights += [onnx.numpy_helper.from_array(tensors[part], part) for part in parts]
        nodes.append(make("Gemm", [before, *parts], [f"h{number}"], transB=1))
        before = f"h{number}"
        if name != names[-1]:
            nodes.append(make("Tanh", [before], [f"t{number}"]))
            before = f"t{number}"
    rows = [onnx.helper.make_tensor_value_info("o", onnx.TensorProto.FLOAT, [1, 4])]
    given = [onnx.helper.make_tensor_value_info(before, onnx.TensorProto.FLOAT, [1, 2])]
    graph = onnx.helper.make_graph(nodes, "actor", rows, given, weights)
    onnx.save(onnx.helper.make_model(graph), tmp_path / "actor.onnx")
    policy = {"file": str(tmp_path / "actor.onnx"), "normalizer": str(FOLDER / "ppo_gtm.pkl")}
    act = Deployed(zipped.changed(policy=policy), aircraft("ppo_gtm")).act
    for entry in SLOPES["ppo_gtm"]:
        action = np.array(act(np.array(entry["observation"]))).ravel()
        np.testing.assert_allclose(action, entry["action"], rtol=0, atol=1e-12)
    with pytest.raises(BadInputError, match="contains the activations"):
        _ = zipped.changed(policy=policy | {"activation": "tanh"}).actor
