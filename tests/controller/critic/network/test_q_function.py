"""Policies of functions Q(x, u)."""

import json
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from network_files import onnx_file, read, torch_file

from hfa import BadInputError, from_network

HERE = Path(__file__).parent
RNG = np.random.default_rng(9)
pytestmark = pytest.mark.usefixtures("folder")


def test_default_torch_exports_are_read(game):
    """The default ONNX export of a Q function in PyTorch is read with the actions of PyTorch."""
    pytest.importorskip("onnx", reason="the package onnx is not installed")
    expected = json.loads((HERE / "torch_2_13.json").read_text(encoding="utf-8"))["q"]
    path = HERE / "torch_2_13_q.onnx"
    critic = from_network(game, path)
    for row, x in enumerate(expected["x"]):
        policy = np.array(critic.policy(x)).ravel()
        assert policy == pytest.approx(expected["mu"][row], rel=1e-11)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("inputs", [0, 5])
def test_the_policy_of_a_quadratic_form_is_linear(game, sign, inputs):
    """The policy of Q = z'Hz with z = (x, u) has the gain H_uu⁻¹ H_ux.

    H is positive or negative definite. The graph has one input z or two inputs x and u.
    """
    root = RNG.normal(size=(11, 11))
    H = sign * root @ root.T
    joined = [] if not inputs else [("Concat", "x u", "z", {"axis": 1})]
    z = "z" if inputs else "x"
    nodes = [
        *joined,
        ("MatMul", f"{z} H", "h"),
        ("Mul", f"{z} h", "terms"),
        ("MatMul", "terms ones", "y"),
    ]
    constants = {"H": H, "ones": np.ones((11, 1))}
    states = 6 if inputs else 11
    critic = from_network(game, onnx_file("q.onnx", nodes, constants, states=states, inputs=inputs))
    assert set(critic.network) == {"policy"}
    assert critic.origin.endswith("= Q(x, u), u from dQ/du = 0")
    assert pytest.approx(np.linalg.solve(H[6:, 6:], H[6:, :6]), rel=1e-9) == critic.K


def test_the_policy_is_nan_if_curvature_changes_sign():
    """Q = (1 - x) u² + u has the policy -1 / (2 (1 - x)) for x < 1, and no minimum at x = 2."""
    xu = ca.SX.sym("xu", 2)
    Q = ca.Function("Q", [xu], [(1.0 - xu[0]) * xu[1] ** 2 + xu[1]])
    policy = read(Q, states=1, inputs=1).policy
    assert float(policy(0.5)) == pytest.approx(-1.0)
    assert not np.isfinite(float(policy(2.0)))


@pytest.mark.parametrize(
    ("power", "says"),
    [
        (lambda u: u**3, "is not quadratic in u"),
        (lambda u: u**2 + 1e-12 * ca.tanh(u), "is not quadratic in u"),
        (lambda u: u**2 + ca.fmax(u, 5.0), "is not quadratic in u"),
        (lambda u: u**2 / (1.0 + u), "is not quadratic in u"),
        (lambda u: u, "has neither a minimum nor a maximum over u"),
    ],
)
def test_a_q_not_quadratic_in_u_is_refused(power, says):
    """A Q that is not quadratic in u, or has neither a minimum nor a maximum over u, is refused."""
    xu = ca.SX.sym("xu", 2)
    Q = ca.Function("Q", [xu], [xu[0] ** 4 + power(xu[1])])
    with pytest.raises(BadInputError, match=says):
        read(Q, states=1, inputs=1)


def test_the_actor_beside_two_q_functions_is_read(game):
    """Of a file with an actor and two Q functions, the actor is read, with network="policy=actor" and
    without. With network="q1", the file is refused: this Q function is not quadratic in u.

    At x = 0, where the slope of tanh is 1, that of the actor is the product of its weights.
    """
    tensors = {"actor.0.weight": RNG.normal(size=(8, 6)), "actor.2.weight": RNG.normal(size=(5, 8))}
    for name in ("q1", "q2"):
        tensors |= {
            f"{name}.0.weight": RNG.normal(size=(8, 11)),
            f"{name}.2.weight": RNG.normal(size=(1, 8)),
        }
    path = torch_file("sac.pt", tensors)
    with pytest.raises(BadInputError, match=r"Q\(x, u\) is not quadratic in u; export the policy"):
        from_network(game, path, network="q1", activation="relu")
    actor = tensors["actor.2.weight"] @ tensors["actor.0.weight"]
    for network in ("policy=actor", ""):
        critic = from_network(game, path, network=network, activation="tanh")
        assert pytest.approx(-actor, rel=1e-12) == critic.K
        assert critic.declared.notes == ("not used: q1, q2",)
